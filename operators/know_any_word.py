"""Objects > Know Any Word: fetch a model that knows more words, and ask for the refused ones again."""

from __future__ import annotations

import bpy

from ..engine.project.refused_prompts import NotFound, read_offer
from ..engine.workers.jobs import any_word_arguments
from ..gaussian_heritage_addon.blender.drawn_text import draw_text
from ..gaussian_heritage_addon.setup.model_files import find_model, require_source
from ..gaussian_heritage_addon.setup.preferences import model_folder
from ..gaussian_heritage_addon.splats.properties import project_of
from .segmenting import SegmentOperator

_DIALOG_WIDTH, _DIALOG_LINE_LENGTH = 500, 75
"""Width of the dialog in pixels at the default interface scale, and the number of characters that fit a line."""


class HERITAGE_OT_know_any_word(SegmentOperator):
    """Fetch a model that knows any word, after showing its licence, and ask for the words again that were not found"""

    bl_idname = "heritage.know_any_word"
    bl_label = "Know Any Word"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show size, licence and time, and ask for confirmation."""
        _offer(context)
        answer: set[str] = context.window_manager.invoke_props_dialog(
            self, width=_DIALOG_WIDTH, confirm_text="Fetch and Ask Again"
        )
        return answer

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the dialog."""
        model = find_model(_offer(context).offer)
        self.layout.label(text=model.title)
        draw_text(
            self.layout,
            "It is fetched once for all projects. Then describing a scene takes about a minute, once.",
            line_length=_DIALOG_LINE_LENGTH,
        )
        draw_text(self.layout, "It was not tested with its real weights yet.", line_length=_DIALOG_LINE_LENGTH)
        for line in (*model.terms, *([model_folder()] if model_folder() else model.sources)):
            draw_text(self.layout, line, line_length=_DIALOG_LINE_LENGTH)

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for all texts that were not found."""
        not_found, folder = _offer(context), model_folder()
        require_source(not_found.offer, folder, online=bpy.app.online_access)
        return any_word_arguments([one.text for one in not_found.refusals], not_found.offer, folder)


def _offer(context: bpy.types.Context) -> NotFound:
    return read_offer(project_of(context.scene.heritage))


CLASSES = [HERITAGE_OT_know_any_word]
