"""The add-on in Blender: engine jobs, splat objects, panels and preferences."""

import bpy

from . import (
    display_settings,
    following,
    guards,
    job_runner,
    measurement_history,
    open_projects,
    panels,
    pictures,
    preferences_page,
    preset_times,
    problems,
    properties,
    solid_mode,
    splat_view,
    translations,
)
from .preferences import user_folder

__all__ = ["register", "unregister"]

_CLASSES = [*preferences_page.CLASSES, *properties.CLASSES, *display_settings.CLASSES, *panels.CLASSES]


def register() -> None:
    """Add the classes and properties of the add-on to Blender."""
    problems.set_log_folder(lambda: user_folder("log"))
    for cls in _CLASSES:
        guards.register_class(cls)
    properties.register()
    display_settings.register()
    job_runner.register()
    solid_mode.register()
    open_projects.register()
    measurement_history.register()
    following.register()
    splat_view.register()
    translations.register()


def unregister() -> None:
    """Remove them from Blender."""
    translations.unregister()
    splat_view.unregister()
    following.unregister()
    measurement_history.unregister()
    open_projects.unregister()
    solid_mode.unregister()
    job_runner.unregister()
    preset_times.stop()
    pictures.unregister()
    display_settings.unregister()
    properties.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
    problems.set_log_folder(None)
