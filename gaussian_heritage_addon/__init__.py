"""The add-on in Blender: engine jobs, splat objects, panels and preferences."""

from .blender import guards, problems
from .jobs import job_runner, preset_times, scene_question
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
from .project import following, object_state, open_projects, project_history, ruler_view
from .setup.preferences import user_folder
from .splats import display_settings, edited_splats, properties, solid_mode, splat_view, view_selection

_WITH_CLASSES = (
    preferences_page, properties, object_state, display_settings, scene_panel, objects_panel, by_hand_panel,
    display_panel, progress_panel, curve_panel,
)  # fmt: skip
_WITH_MORE = (
    properties, object_state, display_settings, job_runner, preset_times, scene_question, solid_mode, open_projects,
    following, project_history, edited_splats, splat_view, view_selection, ruler_view,
)  # fmt: skip


def register() -> None:
    """Add the classes and properties of the add-on to Blender."""
    problems.set_log_folder(lambda: user_folder("log"))
    for module in _WITH_CLASSES:
        for cls in module.CLASSES:
            guards.register_class(cls)
    for module in _WITH_MORE:
        module.register()
    translations.register()
    guards.on_unregister(translations.unregister)


def unregister() -> None:
    """Remove them from Blender, and the operators."""
    guards.unregister()
    problems.set_log_folder(None)
