"""Isolate objects by text or by clicks on photos. Each object gets its own collection."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
from bpy.props import CollectionProperty, FloatProperty, StringProperty

from ..engine.core.errors import PromptError
from ..engine.workers.jobs import Click, click_arguments, text_arguments
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.project.visible_splats import viewport_camera
from ..gaussian_heritage_addon.splats.properties import HeritageClick
from .segmenting import SegmentOperator, clicks_of

_DIALOG_WIDTH = 350


@call_properties
class HERITAGE_OT_isolate(SegmentOperator):
    """Isolate the objects named in the prompt (separate several with commas), or the object clicked on photos"""

    bl_idname = "heritage.isolate"
    bl_label = "Isolate"
    # Blender's own German has another word for operators of this name.
    bl_translation_context = bpy.app.translations.contexts.default

    # SKIP_SAVE everywhere: values of one call must not become the defaults of the next.
    prompt: str = StringProperty(name="Prompt", description="The object in English words, for example vase")
    photo: str = StringProperty(name="Photo", description="Name of the clicked photo, instead of a prompt")
    x: float = FloatProperty(name="X", description="Pixels from the left edge of the photo", min=0.0)
    y: float = FloatProperty(name="Y", description="Pixels from the top edge of the photo", min=0.0)
    clicks: Sequence[HeritageClick] = CollectionProperty(
        type=HeritageClick, name="Clicks", description="Clicks on one object, instead of a prompt"
    )
    name: str = StringProperty(name="Name", description="Name of the object; empty: the prompt")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the words where none are given, as when it is called from a menu."""
        if self.prompt.strip() or self.photo or self.clicks:
            return super().invoke(context, event)
        self.prompt = context.scene.heritage.prompt
        answer: set[str] = context.window_manager.invoke_props_dialog(self, width=_DIALOG_WIDTH, confirm_text="Isolate")
        return answer

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the dialog."""
        self.layout.prop(self, "prompt", text="", placeholder="vase, teapot")

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for the prompt or the clicks."""
        clicks = clicks_of(self) + ([Click(self.photo, self.x, self.y)] if self.photo else [])
        if bool(self.prompt.strip()) == bool(clicks):
            raise PromptError("Enter what to isolate: a prompt in words, or clicks on a photo.")
        name = self.name.strip()
        if clicks:
            return click_arguments(clicks, name)
        # Left and right of a text are those of the view in which the button was pressed.
        return text_arguments(self.prompt, name, viewport_camera(context))


CLASSES = [HERITAGE_OT_isolate]
