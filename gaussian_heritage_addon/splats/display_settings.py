"""How the viewports show splats: properties of a scene, and the choice that fits the computer."""

from __future__ import annotations

from collections.abc import Collection

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from ..blender.guards import add_property
from ..blender.typed_properties import blender_properties
from .properties import apply_blending, apply_photo_opacity
from .selection import heritage_objects
from .solid_mode import viewports
from .splat_nodes import (
    AS_TRAINED,
    DISPLAY,
    SHAPES,
    display_input,
    set_display_input,
    show_in_edit_mode,
)

_MOST_ON_CARD, _MOST_ON_PROCESSOR = 2_000_000, 400_000
"""Gaussians that a graphics card, and a processor without one, draw while the view turns."""
_AS_DOTS_KEY = "heritage_as_dots"
"""Custom property: whether the display of the object is off in the viewports for a Blender without the add-on."""


def apply_display(scene: bpy.types.Scene) -> None:
    """Let the display of `scene` decide what Blender itself draws of its splats: their shapes, or only their bounds."""
    shapes = scene.heritage_display.kind == "SHAPES"
    for obj in heritage_objects(scene):
        if display_input(obj, SHAPES) != shapes:
            set_display_input(obj, SHAPES, shapes)
        show_in_edit_mode(obj, shapes=shapes)
        if obj.get(_AS_DOTS_KEY) is not None:
            del obj[_AS_DOTS_KEY]
            if DISPLAY in obj.modifiers:
                obj.modifiers[DISPLAY].show_viewport = True


def show_without_addon() -> None:
    """Let Blender itself draw the splats of this file, which is about to be saved: one may open it without the add-on.

    Shapes are drawn, or a dot for each Gaussian of an object with so many that shapes would keep Blender waiting.
    """
    for scene in bpy.data.scenes:
        for obj in heritage_objects(scene):
            if obj.library is not None or display_input(obj, SHAPES) is None:
                continue
            if len(obj.data.vertices) <= _MOST_ON_PROCESSOR:
                set_display_input(obj, SHAPES, True)
            elif obj.modifiers[DISPLAY].show_viewport:
                obj[_AS_DOTS_KEY] = True
                obj.modifiers[DISPLAY].show_viewport = False


def fit_arrived(scene: bpy.types.Scene, arrived: Collection[bpy.types.ID]) -> None:
    """Fit the blending of `scene` and of splats that were appended or linked to each other.

    Where the scene had no splats before, it blends as these did. Otherwise, they blend as the scene does.
    """
    splats = heritage_objects(scene)
    known = [display_input(obj, AS_TRAINED) for obj in splats if obj in arrived]
    if known and all(obj in arrived for obj in splats):
        scene.heritage.blending = "TRAINED" if known[0] else "LINEAR"
    apply_blending(scene)


def apply_displays() -> None:
    """Show the splats of every scene of the file as its settings say, as after it was saved or loaded."""
    for scene in bpy.data.scenes:
        apply_display(scene)


def choose_display(scene: bpy.types.Scene, count: int, *, software: bool) -> None:
    """Choose the share of `count` Gaussians that this computer can draw while the view turns."""
    most = _MOST_ON_PROCESSOR if software else _MOST_ON_CARD
    scene.heritage_display.share = min(1.0, max(0.05, most / max(1, count)))


def _kind_changed(properties: HeritageDisplay, context: bpy.types.Context) -> None:
    scene = properties.id_data
    apply_display(scene)
    apply_photo_opacity(scene)
    for area in viewports(scene):
        # Blender would outline each of the shapes.
        area.spaces.active.overlay.show_outline_selected = properties.kind != "SHAPES"


@blender_properties
class HeritageDisplay(bpy.types.PropertyGroup):
    """Display of the splats in the viewports: ``scene.heritage_display``. Renders always show all Gaussians."""

    kind: str = EnumProperty(
        name="Display",
        description="How the viewports show splats. Renders always show all Gaussians",
        items=[
            ("SPLATS", "Splats", "As trained, in all viewport modes"),
            ("POINTS", "Points", "A dot for each Gaussian, the fastest"),
            ("SHAPES", "Shapes", "Blender's own objects, for previews with EEVEE and Cycles; slow"),
        ],
        update=_kind_changed,
    )
    share: float = FloatProperty(
        name="Share",
        description="Share of the Gaussians in view that are drawn, the most important first: "
        "opacity times mean diameter, divided by the distance",
        min=0.01,
        max=1.0,
        default=1.0,
        subtype="FACTOR",
    )
    lighter: bool = BoolProperty(
        name="Lighter While Turning",
        description="Draw with fewer pixels while the view moves, and sharpen the picture when it rests",
        default=True,
    )


CLASSES = [HeritageDisplay]


def register() -> None:
    """Add the properties to scenes. Their classes must be registered already."""
    add_property(bpy.types.Scene, "heritage_display", HeritageDisplay)
