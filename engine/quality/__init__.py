"""Measurements of the engine itself: objects against true masks, presets against run time, and numerical stability.

The extension's zip goes without this package.
"""
