"""Places a project's splats and cameras as measured: level, in metres, with the origin and north that the user gave.

The measured frame becomes Blender's world. Where the user has moved or scaled an object, it keeps its place relative to
the others.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..engine.errors import ObjectError
from ..engine.scene import ExportFrame, Measurement
from .properties import heritage_objects, photo_of

__all__ = [
    "RULER_KEY",
    "apply_measurement",
    "frame_of_object",
    "is_metric",
    "placement_of",
    "placement_properties",
    "world_from_scene",
]

Float64 = NDArray[np.float64]

_MATRIX_KEY = "heritage_placement"
"""Custom property: the matrix, row by row, that took the object from the world of the scene to that of Blender."""
_METRIC_KEY = "heritage_metric"
"""Custom property: whether that matrix made Blender's unit a metre."""
RULER_KEY = "heritage_ruler"
"""Custom property of a ruler, which moves with what it measures."""
_MAX_ENTRY = 1e15
_MIN_THICKNESS = 1e-7
"""Smallest scale of an object relative to its largest: Blender's float32 holds no smaller one after a rotation."""


def apply_measurement(scene: bpy.types.Scene, measurement: Measurement) -> None:
    """Place the splats and cameras of `scene` as measured, instead of as they were measured before.

    Lengths are shown in metres when the scale is known; otherwise without a unit, since theirs is unknown.

    Raises
    ------
    ObjectError
        When the placement that is stored on an object was changed by another program.
    """
    metric = measurement.metres_per_unit is not None
    placement = measurement.measured_from_world
    objects = [*heritage_objects(scene), *(obj for obj in scene.objects if photo_of(obj) or RULER_KEY in obj)]
    moves = [(obj, placement @ np.linalg.inv(world_from_scene(obj))) for obj in objects]
    # Children follow their parents.
    roots = [(obj, move) for obj, move in moves if not any(parent in objects for parent in _parents(obj))]
    for obj, move in roots:
        matrix = move @ np.array(obj.matrix_world, np.float64)
        if photo_of(obj):
            size = _scale_of(move)
            # Blender ignores the scale of a camera, but draws its frame with it.
            matrix[:3, :3] /= size
            obj.data.clip_start, obj.data.clip_end = obj.data.clip_start * size, obj.data.clip_end * size
        obj.matrix_world = Matrix(matrix.tolist())
    for obj in objects:
        obj[_MATRIX_KEY] = placement.ravel().tolist()
        obj[_METRIC_KEY] = metric
    scene.unit_settings.system = "METRIC" if metric else "NONE"
    scene.unit_settings.scale_length = 1.0


def placement_of(obj: bpy.types.Object) -> Float64:
    """Return ``matrix_world`` of `obj`, which can be inverted.

    Raises
    ------
    ObjectError
        When a scale of the object, or of its parent, is 0.
    """
    matrix = np.array(obj.matrix_world, np.float64)
    largest, _, smallest = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    if not smallest > _MIN_THICKNESS * largest:
        raise ObjectError(f"{obj.name} is flattened. Give it a scale other than 0.")
    return matrix


def placement_properties(obj: bpy.types.Object) -> dict[str, Any]:
    """Return the custom properties that say how `obj` was placed; others may be given them, also after its removal."""
    world_from_scene(obj)  # refuses what another program changed
    found = {_MATRIX_KEY: list(obj[_MATRIX_KEY])} if _MATRIX_KEY in obj else {}
    return {**found, _METRIC_KEY: is_metric(obj)} if found else {}


def world_from_scene(obj: bpy.types.Object) -> Float64:
    """Return the similarity [4, 4] by which `obj` was placed as measured; the identity where nothing was measured.

    Raises
    ------
    ObjectError
        When it was changed by another program.
    """
    stored = obj.get(_MATRIX_KEY)
    if stored is None:
        return np.eye(4)
    try:
        matrix = np.array([float(value) for value in stored]).reshape(4, 4)
    except (TypeError, ValueError):
        matrix = np.full((4, 4), np.nan)
    # Written so that NaN fails.
    if not (np.abs(matrix).max() <= _MAX_ENTRY and abs(np.linalg.det(matrix)) > 0):
        raise ObjectError(f"The measured placement of {obj.name} was changed. Open the project in a new file.")
    return matrix


def frame_of_object(obj: bpy.types.Object) -> ExportFrame:
    """Return the frame of files exported from `obj`: Blender's world, in metres where its scene was measured."""
    return ExportFrame("blender", world_from_scene(obj), 1.0 if is_metric(obj) else None)


def _scale_of(matrix: Float64) -> float:
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))


def is_metric(obj: bpy.types.Object) -> bool:
    """Return whether `obj` was placed in metres."""
    return obj.get(_METRIC_KEY) in (True, 1)


def _parents(obj: bpy.types.Object) -> Iterable[bpy.types.Object]:
    while obj.parent is not None:
        obj = obj.parent
        yield obj
