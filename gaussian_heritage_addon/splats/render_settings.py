"""The settings of a scene that a render of splats needs. The user's own are changed on request only."""

from __future__ import annotations

import contextlib
import json

import bpy

from ...engine.core.errors import FormatError
from ...engine.core.files import parse_json
from ..blender.default_objects import untouched_defaults
from .properties import apply_blending, photo_of, view_transform_of
from .selection import heritage_objects

_CYCLES = {
    "transparent_max_bounces": 256,
    "min_transparent_bounces": 256,
    "pixel_filter_type": "BOX",
    "filter_width": 0.01,
    "use_denoising": False,
    "use_adaptive_sampling": False,
    "samples": 1,
    "preview_samples": 1,
}
"""One ray through the centre of each pixel. A ray ends after 256 Gaussians, and not at random before, which leaves
white specks: docs/design_notes/blender.md. Splats need one sample; other objects need more, and a wider filter."""
_FIRST_ENGINES = ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT")
_FIRST_VIEW_TRANSFORM = "AgX"
_TOLERANCE = 1e-6
"""Settings are stored in single precision."""


def is_untouched(scene: bpy.types.Scene) -> bool:
    """Return whether `scene` has only objects and render settings of a new Blender file, and what the add-on added."""
    defaults = untouched_defaults(scene)
    for obj in scene.objects:
        is_default = obj in defaults or (obj.type == "CAMERA" and obj.name == "Camera")
        if not is_default and obj.heritage.role == "NONE" and not photo_of(obj):
            return False
    rna = scene.cycles.bl_rna.properties
    return (
        scene.render.engine in _FIRST_ENGINES
        and scene.view_settings.view_transform == _FIRST_VIEW_TRANSFORM
        and all(_is_equal(getattr(scene.cycles, name), rna[name].default) for name in _CYCLES)
    )


def set_up_render(scene: bpy.types.Scene) -> None:
    """Set Cycles and the view transform up to draw splats as the engine does, and remember the former settings."""
    wanted, former = _wanted(scene), _current(scene)
    earlier = _former(scene)
    # What was set up before is not what the user had.
    changed = {name: earlier.get(name, value) for name, value in former.items() if not _is_equal(value, wanted[name])}
    scene.heritage.former_settings = json.dumps(earlier | changed)
    _apply(scene, wanted)
    apply_blending(scene)


def missing_settings(scene: bpy.types.Scene) -> list[str]:
    """Return what a render of the splats of `scene` lacks.

    These are `engine`, `transparent_bounces`, `samples` and `view_transform`, in this order.

    More samples than one are missed only in a scene without other shapes, which need them.
    """
    cycles = scene.cycles
    missing = []
    if scene.render.engine == "CYCLES":
        needed = ("transparent_max_bounces", "min_transparent_bounces")
        if any(getattr(cycles, name) < _CYCLES[name] for name in needed):
            missing.append("transparent_bounces")
        others = [obj for obj in scene.objects if obj.type == "MESH" and obj.heritage.role == "NONE"]
        if cycles.samples > 1 and not others:
            missing.append("samples")
    else:
        missing.append("engine")
    if scene.view_settings.view_transform != view_transform_of(scene):
        missing.append("view_transform")
    return missing


def can_restore(scene: bpy.types.Scene) -> bool:
    """Return whether `scene` has no splats any more and still the settings that were made for them."""
    return not heritage_objects(scene) and bool(_former(scene))


def restore_settings(scene: bpy.types.Scene) -> None:
    """Set what `set_up_render` changed to what it was. What was changed since then stays."""
    former, current, wanted = _former(scene), _current(scene), _wanted(scene)
    _apply(scene, {name: value for name, value in former.items() if _is_equal(current[name], wanted[name])})
    scene.heritage.former_settings = ""


def _wanted(scene: bpy.types.Scene) -> dict[str, object]:
    return {"engine": "CYCLES", "view_transform": view_transform_of(scene), **_CYCLES}


def _current(scene: bpy.types.Scene) -> dict[str, object]:
    cycles = {name: getattr(scene.cycles, name) for name in _CYCLES}
    return {"engine": scene.render.engine, "view_transform": scene.view_settings.view_transform, **cycles}


def _apply(scene: bpy.types.Scene, settings: dict[str, object]) -> None:
    for name, value in settings.items():
        owner = {"engine": scene.render, "view_transform": scene.view_settings}.get(name, scene.cycles)
        # A file of another version of Blender can name an engine or a view transform that this one does not have.
        with contextlib.suppress(TypeError, ValueError, OverflowError):
            setattr(owner, name, value)


def _former(scene: bpy.types.Scene) -> dict[str, object]:
    try:
        stored = parse_json(scene.heritage.former_settings or "{}", dict, source="The former settings", advice="")
    except FormatError:
        return {}
    return {name: stored[name] for name in _wanted(scene) if name in stored}


def _is_equal(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, (int, float)):
        return abs(one - other) <= _TOLERANCE
    return one == other
