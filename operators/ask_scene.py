"""Ask words of the scene that is being trained, and end with the question or its answer."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.jobs import scene_question


@call_properties
class HERITAGE_OT_ask_scene(bpy.types.Operator):
    """Look for what the words name in the scene so far, while it is being trained. Nothing is stored"""

    bl_idname = "heritage.ask_scene"
    bl_label = "Ask the Scene So Far"

    words: str = StringProperty(name="Words", description="Things in English words, for example vase")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine that answers."""
        scene_question.ask(self.words)
        return {"FINISHED"}


class HERITAGE_OT_cancel_question(bpy.types.Operator):
    """Stop looking. The reconstruction goes on"""

    bl_idname = "heritage.cancel_question"
    bl_label = "Cancel Question"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stop the engine that answers."""
        scene_question.cancel()
        return {"FINISHED"}


class HERITAGE_OT_dismiss_answer(bpy.types.Operator):
    """Remove the answer from the panel"""

    bl_idname = "heritage.dismiss_answer"
    bl_label = "Dismiss Answer"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Forget the answer."""
        scene_question.dismiss()
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_ask_scene, HERITAGE_OT_cancel_question, HERITAGE_OT_dismiss_answer]
