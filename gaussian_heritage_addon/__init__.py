"""Inside Blender: engine jobs, splat objects, panels and preferences."""

import bpy

from . import job_runner, panels, pictures, preferences_page, properties

__all__ = ["register", "unregister"]

_CLASSES = [*preferences_page.CLASSES, *properties.CLASSES, *panels.CLASSES]


def register() -> None:
    """Add the add-on's classes and properties to Blender."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    properties.register()
    job_runner.register()


def unregister() -> None:
    """Take them away again."""
    job_runner.unregister()
    pictures.unregister()
    properties.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
