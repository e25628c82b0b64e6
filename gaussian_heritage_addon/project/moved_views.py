"""Views that follow a scene when it is measured: what was seen before is seen after, and stands upright."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...engine.core.arrays import Float64
from ...engine.scene import similarity_scale
from ..splats.solid_mode import viewports


def follow_move(scene: bpy.types.Scene, move: Float64) -> None:
    """Move the views of all 3D viewports of `scene` by the similarity `move`, [4, 4], that its splats were moved by."""
    if bpy.app.background or np.allclose(move, np.eye(4)):
        return
    for area in viewports(scene):
        space = area.spaces.active
        move_view(space.region_3d, move)
        size = similarity_scale(move)
        space.clip_start, space.clip_end = space.clip_start * size, max(space.clip_end, space.clip_end * size)


def move_view(view: bpy.types.RegionView3D, move: Float64) -> None:
    """Move one view. Its roll is taken away: a scene that was levelled is looked at upright."""
    size = similarity_scale(move)
    turn = Matrix((move[:3, :3] / size).tolist())
    backwards = turn @ (view.view_rotation @ Vector((0.0, 0.0, 1.0)))
    view.view_location = Matrix(move.tolist()) @ view.view_location
    view.view_distance *= size
    view.view_rotation = backwards.to_track_quat("Z", "Y")
