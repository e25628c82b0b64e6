"""Isolate an object by a text or a click on a photo; it gets a collection of its own."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..engine.errors import HeritageError, PromptError
from ..gaussian_heritage_addon import job_runner

__all__ = ["CLASSES"]


class HERITAGE_OT_isolate(bpy.types.Operator):
    """Isolate what the prompt names, or what lies at a pixel of a photo"""

    bl_idname = "heritage.isolate"
    bl_label = "Isolate"
    bl_options = {"REGISTER", "UNDO"}

    prompt: bpy.props.StringProperty(name="Prompt", description="What it is, in words")  # type: ignore[valid-type]
    photo: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Photo", description="Name of the photo that was clicked, instead of a prompt"
    )
    x: bpy.props.FloatProperty(name="X", description="Pixels from the photo's left edge", min=0.0)  # type: ignore[valid-type]
    y: bpy.props.FloatProperty(name="Y", description="Pixels from the photo's upper edge", min=0.0)  # type: ignore[valid-type]
    name: bpy.props.StringProperty(name="Name", description="Of the object; empty: the prompt")  # type: ignore[valid-type]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only where a project is open."""
        cls.poll_message_set("Import a photo folder or open a project first.")
        return bool(context.scene.heritage.project)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine; the objects are added when it is done."""
        try:
            project = Path(bpy.path.abspath(context.scene.heritage.project))
            state = job_runner.start("segment", project, "segment", str(project), *self._what())
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, "Working in the background; see the Heritage panel." if state is None else state.message)
        return {"FINISHED"}

    def _what(self) -> list[str]:
        """Return the engine's arguments for what was asked."""
        prompt, name = self.prompt.strip(), self.name.strip()
        if bool(prompt) == bool(self.photo):
            raise PromptError("Say what to isolate: a prompt in words, or a photo with a pixel in it.")
        arguments = ["--prompt", prompt] if prompt else ["--click", f"{self.photo}={self.x:g},{self.y:g}"]
        return [*arguments, "--name", name or prompt or "object"]


CLASSES = [HERITAGE_OT_isolate]
