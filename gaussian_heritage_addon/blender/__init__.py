"""Blender's own things made convenient: text, errors, typed properties, node trees, places of objects. Nothing here knows a project."""
