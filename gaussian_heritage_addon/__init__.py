"""The add-on in Blender: engine jobs, splat objects, panels and preferences."""

import bpy

from .blender import guards, problems
from .jobs import job_runner, preset_times
from .language import translations
from .panels import (
    by_hand_panel,
    curve_panel,
    display_panel,
    objects_panel,
    preferences_page,
    progress_panel,
    scene_panel,
)
from .project import following, object_state, open_projects, pictures, project_history, ruler_view
from .setup.preferences import user_folder
from .splats import display_settings, edited_splats, properties, solid_mode, splat_view, view_selection

_CLASSES = [
    *preferences_page.CLASSES,
    *properties.CLASSES,
    *object_state.CLASSES,
    *display_settings.CLASSES,
    *scene_panel.CLASSES,
    *objects_panel.CLASSES,
    *by_hand_panel.CLASSES,
    *display_panel.CLASSES,
    *progress_panel.CLASSES,
    *curve_panel.CLASSES,
]


def register() -> None:
    """Add the classes and properties of the add-on to Blender."""
    problems.set_log_folder(lambda: user_folder("log"))
    for cls in _CLASSES:
        guards.register_class(cls)
    properties.register()
    object_state.register()
    display_settings.register()
    job_runner.register()
    preset_times.register()
    solid_mode.register()
    open_projects.register()
    following.register()
    project_history.register()
    edited_splats.register()
    splat_view.register()
    view_selection.register()
    ruler_view.register()
    translations.register()


def unregister() -> None:
    """Remove them from Blender."""
    translations.unregister()
    ruler_view.unregister()
    view_selection.unregister()
    splat_view.unregister()
    edited_splats.unregister()
    project_history.unregister()
    following.unregister()
    open_projects.unregister()
    solid_mode.unregister()
    preset_times.unregister()
    job_runner.unregister()
    pictures.unregister()
    display_settings.unregister()
    object_state.unregister()
    properties.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
    problems.set_log_folder(None)
