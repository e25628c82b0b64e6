"""Speed and likeness of splats in Blender."""
