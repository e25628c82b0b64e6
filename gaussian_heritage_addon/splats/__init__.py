"""Gaussians in Blender: as meshes with attributes, drawn in viewports, rendered by nodes, selected."""
