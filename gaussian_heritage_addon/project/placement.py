"""Places a project's splats and cameras as measured: level, in metres, with the origin and north that the user gave.

The measured frame becomes Blender's world. Where the user has moved or scaled an object, it keeps its place relative to
the others.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...engine.core.arrays import Float64
from ...engine.core.errors import ObjectError
from ...engine.scene import ExportFrame, Measurement, similarity_scale
from ..blender.mesh_frame import stored_matrix
from ..blender.world_placement import parents_of, set_world_matrix, world_matrix
from ..splats.properties import photo_of, project_of
from ..splats.splats import SplatScene

_MATRIX_KEY = "heritage_placement"
"""Custom property: the matrix, row by row, that took the object from the world of the scene to that of Blender."""
_METRIC_KEY = "heritage_metric"
"""Custom property: whether that matrix made Blender's unit a metre."""
RULER_KEY = "heritage_ruler"
"""Custom property of a ruler, which moves with what it measures."""
GROUND_KEY = "heritage_ground"
"""Custom property of a plane that the user laid on the ground, which goes on lying there."""
_SAME = 1e-9
"""Difference from the identity up to which a move is none: moves are computed as doubles."""
_NEAR = 2e-6
"""Difference, relative to the largest entry, up to which an object stands somewhere already: Blender uses float32."""
_MIN_THICKNESS = 1e-7
"""Smallest scale of an object relative to its largest: Blender's float32 holds no smaller one after a rotation."""


def apply_measurement(scene: bpy.types.Scene, project: Path, measurement: Measurement) -> None:
    """Place the splats, cameras, rulers and ground of `project` in `scene` as measured, instead of as before.

    What belongs to another project or to none, such as an imported file or an object of another .blend, stays.
    Lengths are shown in metres when the scale is known; otherwise without a unit, since theirs is unknown.

    Raises
    ------
    ObjectError
        When the placement that is stored on an object was changed by another program, or an object cannot be placed
        (see `set_world_matrix`). Nothing is moved then.
    """
    metric = measurement.metres_per_unit is not None
    placement = measurement.measured_from_world
    objects = _measured_objects(scene, project)
    moves = [(obj, placement @ np.linalg.inv(world_from_scene(obj))) for obj in objects]
    # Parents first: their children follow, and only what is left is done to these.
    moves.sort(key=lambda one: len(list(parents_of(one[0]))))
    places = [(obj, move, world_matrix(obj)) for obj, move in moves if not _is_identity(move)]
    placed: list[tuple[bpy.types.Object, Float64]] = []
    try:
        for obj, move, before in places:
            placed.append((obj, before))
            _place(obj, move @ before, similarity_scale(move))
    except ObjectError:
        for obj, before in placed[:-1]:
            _place(obj, before, 1.0)
        raise
    for obj, move, _ in places:
        if photo_of(obj):
            size = similarity_scale(move)
            obj.data.clip_start, obj.data.clip_end = obj.data.clip_start * size, obj.data.clip_end * size
    for obj in [one for one in objects if one.library is None]:
        obj[_MATRIX_KEY] = placement.ravel().tolist()
        obj[_METRIC_KEY] = metric
    if shows_project(scene, project):
        scene.unit_settings.system = "METRIC" if metric else "NONE"
        scene.unit_settings.scale_length = 1.0


def shows_project(scene: bpy.types.Scene, project: Path) -> bool:
    """Return whether `scene` is that of `project`."""
    return bool(scene.heritage.project) and project_of(scene.heritage) == project


def _measured_objects(scene: bpy.types.Scene, project: Path) -> list[bpy.types.Object]:
    """Return the objects of `scene` that stand as `project` is measured: splats, cameras, rulers, ground."""
    is_own = shows_project(scene, project)

    def belongs(obj: bpy.types.Object) -> bool:
        if obj.heritage.project:
            return project_of(obj.heritage) == project
        # The others name no project: they were added for that of the scene.
        return is_own and (bool(photo_of(obj)) or RULER_KEY in obj or GROUND_KEY in obj)

    return [obj for obj in scene.objects if belongs(obj)]


def _place(obj: bpy.types.Object, matrix: Float64, size: float) -> None:
    if photo_of(obj):
        # Blender ignores the scale of a camera, but draws its frame with it.
        matrix = matrix.copy()
        matrix[:3, :3] /= size
    # A child may stand there already, as its parent was moved.
    if np.abs(world_matrix(obj) - matrix).max() > _NEAR * np.abs(matrix).max():
        set_world_matrix(obj, matrix)


def _is_identity(move: Float64) -> bool:
    return bool(np.abs(move - np.eye(4)).max() <= _SAME)


def scene_placement(whole: bpy.types.Object) -> Float64:
    """Return the matrix [4, 4] from the normalised world of a project to Blender's, where its whole scene stands.

    Raises
    ------
    ObjectError
        When a scale of the scene, or of its parent, is 0.
    """
    matrix = world_matrix(whole) @ frame_of_whole(whole)
    largest, _, smallest = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    if not smallest > _MIN_THICKNESS * largest:
        raise ObjectError(f"{whole.name} is flattened. Give it a scale other than 0.")
    return matrix


def frame_of_whole(whole: bpy.types.Object) -> Float64:
    """Return the matrix [4, 4] from the normalised world of a project to the frame of its whole scene."""
    return SplatScene.of(whole).frame


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
    return stored_matrix(stored, f"The measured placement of {obj.name}")


def frame_of_object(obj: bpy.types.Object) -> ExportFrame:
    """Return the frame of files exported from `obj`: Blender's world, in metres where its scene was measured."""
    return ExportFrame("blender", world_from_scene(obj), 1.0 if is_metric(obj) else None)


def is_metric(obj: bpy.types.Object) -> bool:
    """Return whether `obj` was placed in metres."""
    return obj.get(_METRIC_KEY) in (True, 1)
