"""Which splat objects are at a place of a 3D view, for Blender's own ways to select objects.

Blender itself draws no shape of them that could be clicked; the splats are drawn by `splat_view`.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float64
from ...engine.rasterizer.settings import ALPHA_MIN
from ...engine.scene import RayCaster
from ..blender.guards import add_change_handler, add_load_handler, on_unregister
from ..blender.world_placement import world_matrix
from .line_objects import lines_near
from .sight import Sight, SplatLayer, inside_polygon, seen_on_ray
from .splat_view import shown_splats
from .splats import SplatScene

_MIN_SHARE = 0.2
"""Least share that an object has in what the eye sees at a place where it can be clicked."""
_MIN_OPACITY = 0.15
"""Fainter Gaussians are no part of an object that a box or lasso can catch: floaters would make all objects large."""
_REACH = 6
"""Pixels around a click within which a line, such as a ruler, is taken instead of the splats behind it."""


@dataclass(frozen=True)
class _Known:
    """The Gaussians of an object that are shown, and from what they were made."""

    made_of: tuple[str, int, float]
    caster: RayCaster
    vertices: NDArray[np.intp]
    centers: NDArray[np.float32]


_known: dict[str, _Known] = {}
"""By name of the object. To read the Gaussians of a whole scene takes longer than a click may."""


def selectable_splats(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the splats that the 3D view of `context` draws and that can be selected in Object Mode; none elsewhere.

    With the display *Shapes*, Blender draws them, and selects them itself.
    """
    area, region = context.area, context.region
    is_view = area is not None and area.type == "VIEW_3D" and region is not None and region.type == "WINDOW"
    if not is_view or context.mode != "OBJECT" or context.scene.heritage_display.kind == "SHAPES":
        return []
    return [obj for obj in shown_splats(context) if not obj.hide_select]


def object_seen(objects: list[bpy.types.Object], ray: tuple[Float64, Float64]) -> tuple[bpy.types.Object | None, float]:
    """Return which of `objects` the eye sees along a ray of Blender's world (origin and unit direction), and the
    distance of its surface.

    The distance is infinite where more than half of the light passes. No object is seen where almost all passes.
    """
    seen = seen_on_ray([_layer(obj, number) for number, obj in enumerate(objects)], *ray)
    if seen.label < 0 or seen.share < _MIN_SHARE:
        return None, np.inf
    distance = np.inf if seen.point is None else float(np.linalg.norm(seen.point - ray[0]))
    return objects[seen.label], distance


def objects_within(objects: list[bpy.types.Object], sight: Sight, corners: Float64) -> list[bpy.types.Object]:
    """Return which of `objects` have Gaussians in a region of a view with the corners [C, 2], in pixels."""
    found = []
    for obj in objects:
        matrix = _layer(obj, 0).world_from_own
        points = _of(obj).centers @ matrix[:3, :3].T + matrix[:3, 3]
        if inside_polygon(sight.positions(points), corners).any():
            found.append(obj)
    return found


def hides_splats(context: bpy.types.Context, sight: Sight, place: tuple[int, int], far: float) -> bool:
    """Return whether Blender draws another object over the splats at a place of the view.

    Parameters
    ----------
    context : Context
        Of the region of a 3D view.
    sight : Sight
        What the region shows.
    place : (int, int)
        In pixels from the lower left corner of the region.
    far : float
        Distance of the splats.
    """
    ray = sight.ray(place[0] + 0.5, place[1] + 0.5)
    hit, point, *_ = context.scene.ray_cast(context.evaluated_depsgraph_get(), *ray)
    if hit and np.linalg.norm(np.array(point) - ray[0]) < far:
        return True
    lines = lines_near(context, sight, place, _REACH)
    return bool(lines) and _has_line(context, place, lines)


def _has_line(context: bpy.types.Context, place: tuple[int, int], lines: list[bpy.types.Object]) -> bool:
    """Return whether Blender selects one of `lines` near a place, and leave the selection as it was."""
    selected = set(context.selected_objects)
    x, y = place
    bpy.ops.view3d.select_box(
        xmin=x - _REACH, xmax=x + _REACH, ymin=y - _REACH, ymax=y + _REACH, wait_for_input=False, mode="SET"
    )
    found = any(obj.select_get() for obj in lines)
    for obj in context.visible_objects:
        if obj.select_get() != (obj in selected):
            obj.select_set(obj in selected)
    return found


def _layer(obj: bpy.types.Object, label: int) -> SplatLayer:
    known = _of(obj)
    labels = np.full(len(known.vertices), label, np.int32)
    return SplatLayer(obj.name, known.caster, world_matrix(obj), labels, known.vertices)


def _of(obj: bpy.types.Object) -> _Known:
    made_of = obj.data.name_full, len(obj.data.vertices), obj.heritage.threshold
    if obj.name not in _known or _known[obj.name].made_of != made_of:
        splats = SplatScene.of(obj)
        gaussians = splats.local_gaussians(harmonics=False)
        vertices = np.flatnonzero((gaussians.opacities > ALPHA_MIN) & splats.shown)
        solid = vertices[gaussians.opacities[vertices] > _MIN_OPACITY]
        _known[obj.name] = _Known(made_of, RayCaster(gaussians[vertices]), vertices, gaussians.means[solid])
    return _known[obj.name]


def _forget(changed: list[bpy.types.ID]) -> None:
    names = {data.name_full for data in changed if isinstance(data, bpy.types.Mesh)}
    for name in [name for name, known in _known.items() if known.made_of[0] in names]:
        del _known[name]


def _forget_all() -> None:
    _known.clear()


def register() -> None:
    """Forget Gaussians that change."""
    add_change_handler(_forget)
    add_load_handler(_forget_all)
    on_unregister(_forget_all)
