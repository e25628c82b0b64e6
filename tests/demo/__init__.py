"""Tests of the scripts in demo/ that need no Blender."""
