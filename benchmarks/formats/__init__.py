"""Figures of docs/formats.md: speed and size beside other programs, their readers, and pictures in viewers."""
