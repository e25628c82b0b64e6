"""A project in Blender: its scene, objects, photos and measurements, kept equal in both directions, and exports."""
