"""Blender's own things made convenient: text, errors, properties, node trees, places. Nothing here knows a project."""
