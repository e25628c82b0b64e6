"""Reconstruct the scene of the open project again, from the same photos, with a better preset."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import EnumProperty

from ..engine.core.errors import SettingsError
from ..engine.pipeline.reconstruction_input import better_preset, read_input, repeat_arguments, texts_of_objects
from ..engine.project.content import shown_objects
from ..engine.training.settings import PRESET_LIST
from ..engine.workers.jobs import format_seconds
from ..gaussian_heritage_addon.blender.drawn_text import draw_text
from ..gaussian_heritage_addon.blender.open_dialog import forget_dialog, is_drawn
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.jobs import preset_times
from ..gaussian_heritage_addon.language.translations import translated
from ..gaussian_heritage_addon.splats.properties import project_of
from ..gaussian_heritage_addon.splats.selection import heritage_objects
from .project_operator import ProjectOperator, require_stored, start_job

_DIALOG_WIDTH, _DIALOG_LINE_LENGTH = 460, 65


@call_properties
class HERITAGE_OT_improve_scene(ProjectOperator, bpy.types.Operator):
    """Reconstruct this scene again, in the same project, from the same photos, with a better preset"""

    bl_idname = "heritage.improve_scene"
    bl_label = "Improve Scene"

    preset: str = EnumProperty(
        name="Preset",
        description="How much work is done, and how good the scene becomes",
        items=[
            ("NEXT", "Next Better", "The preset after that of the scene"),
            *((one.name, one.label, one.description if one.offered else "") for one in PRESET_LIST),
        ],
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Say what becomes of the objects, and how long it takes."""
        project = project_of(context.scene.heritage)
        self.preset = self._wanted(project)
        preset_times.ask(Path(read_input(project).photos))
        return context.window_manager.invoke_props_dialog(self, width=_DIALOG_WIDTH, confirm_text="Reconstruct")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the dialog, again when the time is known."""
        is_drawn(context)
        project = project_of(context.scene.heritage)
        photos = Path(read_input(project).photos)
        for line in _consequences(project, self.preset, preset_times.preset_seconds(photos, again=True)):
            draw_text(self.layout, line, line_length=_DIALOG_LINE_LENGTH)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine. The result is imported when it has finished."""
        forget_dialog()
        project = project_of(context.scene.heritage)
        require_stored(heritage_objects(context.scene, "OBJECT"))
        return start_job(self, "reconstruct", project, *repeat_arguments(project, self._wanted(project)))

    def cancel(self, context: bpy.types.Context) -> None:
        """Close the dialog."""
        forget_dialog()

    def _wanted(self, project: Path) -> str:
        wanted = better_preset(project) if self.preset == "NEXT" else self.preset
        if not wanted:
            raise SettingsError("This scene has the best preset already.")
        return wanted


def _consequences(project: Path, preset: str, seconds: dict[str, float] | None) -> list[str]:
    """Return what happens, a sentence each. The time is not known yet where `seconds` is None."""
    objects, texts = shown_objects(project), texts_of_objects(project)
    lines = [translated("The scene is trained again with the preset {}; cameras and masks are kept.", preset)]
    if seconds is None:
        lines.append(translated("Working out how long this takes ..."))
    elif preset in seconds and texts:
        minutes = format_seconds(seconds[preset])
        lines.append(translated("About {} on this computer, without the search for objects.", minutes))
    elif preset in seconds:
        lines.append(translated("About {} on this computer.", format_seconds(seconds[preset])))
    if objects:
        lines.append(
            translated(
                "The {} objects of the project belong to the present Gaussians. They go to the project's trash.",
                len(objects),
            )
        )
    if texts:
        lines.append(translated("Searched for again by their words: {}.", ", ".join(texts)))
    if len(objects) > len(texts):
        lines.append(translated("Objects that were clicked or made by hand stay in this .blend file as they are."))
    return lines


CLASSES = [HERITAGE_OT_improve_scene]
