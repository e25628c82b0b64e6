"""The add-on in Blender: engine jobs, splat objects, panels and preferences."""

import bpy

from . import job_runner, panels, pictures, preferences_page, properties

__all__ = ["register", "unregister"]

_CLASSES = [*preferences_page.CLASSES, *properties.CLASSES, *panels.CLASSES]


def register() -> None:
    """Add the classes and properties of the add-on to Blender."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    properties.register()
    job_runner.register()


def unregister() -> None:
    """Remove them from Blender."""
    job_runner.unregister()
    pictures.unregister()
    properties.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
