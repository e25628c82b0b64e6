"""Isolate objects by text or by clicks on photos; each gets a collection of its own."""

from __future__ import annotations

import bpy

from ..engine.errors import PromptError
from ..gaussian_heritage_addon.prompts import Click, click_arguments, text_arguments
from ..gaussian_heritage_addon.properties import HeritageClick
from .segmenting import Segmenting, clicks_of

__all__ = ["CLASSES"]


class HERITAGE_OT_isolate(Segmenting, bpy.types.Operator):
    """Isolate what the prompt names (several things as "vase;teapot"), or what lies at pixels of photos"""

    bl_idname = "heritage.isolate"
    bl_label = "Isolate"
    bl_options = {"REGISTER", "UNDO"}

    # Nothing is remembered for the next press: each asks for something else.
    prompt: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Prompt", description="What it is, in words", options={"SKIP_SAVE"}
    )
    photo: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Photo", description="Name of the photo that was clicked, instead of a prompt", options={"SKIP_SAVE"}
    )
    x: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="X", description="Pixels from the photo's left edge", min=0.0, options={"SKIP_SAVE"}
    )
    y: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Y", description="Pixels from the photo's upper edge", min=0.0, options={"SKIP_SAVE"}
    )
    clicks: bpy.props.CollectionProperty(  # type: ignore[valid-type]
        type=HeritageClick, name="Clicks", description="On one object, instead of a prompt", options={"SKIP_SAVE"}
    )
    name: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Name", description="Of the object; empty: the prompt", options={"SKIP_SAVE"}
    )

    def what(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for what was asked."""
        clicks = clicks_of(self) + ([Click(self.photo, self.x, self.y)] if self.photo else [])
        if bool(self.prompt.strip()) == bool(clicks):
            raise PromptError("Say what to isolate: a prompt in words, or a photo with a pixel in it.")
        name = self.name.strip()
        return click_arguments(clicks, name) if clicks else text_arguments(self.prompt, name)


CLASSES = [HERITAGE_OT_isolate]
