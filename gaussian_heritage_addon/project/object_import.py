"""Objects of a project as Blender objects: their Gaussians, copied from the scene, with the origin at their foot."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.files import path_within
from ...engine.project.content import ProjectObject
from ...engine.project.objects import load_level, load_membership, load_record, require_intact, state_of
from ...engine.scene import Gaussians, bottom_middle, load_detailed
from ..blender.world_placement import copy_world_matrix
from ..splats.properties import COUNT_KEY, HeritageObject, loading, scene_count
from ..splats.splats import SplatScene
from .object_geometry import moved_gaussians, near_object
from .object_names import ID_KEY, give_name
from .object_state import HeritageState
from .placement import frame_of_whole, placement_properties

_MIN_COPIED_MEMBERSHIP = 0.05
"""Smallest membership of Gaussians that are copied into an object, unless its threshold is lower.

Setting the threshold below it shows no more Gaussians."""


def new_collection(parent: bpy.types.Collection, name: str) -> bpy.types.Collection:
    """Return a new collection in `parent`. Blender adds a number if the name is in use."""
    collection = bpy.data.collections.new(name)
    parent.children.link(collection)
    return collection


def _object_gaussians(
    project: Path, item: ProjectObject, whole: bpy.types.Object
) -> tuple[Gaussians, NDArray[np.int32], NDArray[np.float32]]:
    """Return the Gaussians of an object in the normalised world, their rows in the scene, and their memberships."""
    source, count, frame = SplatScene.of(whole), scene_count(whole), frame_of_whole(whole)
    index = source.index(count)
    require_intact(project, item.id)
    membership = load_membership(project, item.id, count)
    highest_membership = membership
    if item.n_levels > 1:
        levels = [load_level(project, item.id, level, count) for level in range(item.n_levels)]
        highest_membership = np.max([membership, *levels], axis=0)
    # Gaussians added by hand (-1) belong to no object.
    kept = (index >= 0) & (highest_membership[index] >= min(_MIN_COPIED_MEMBERSHIP, item.threshold))
    every = moved_gaussians(source.local_gaussians(), np.linalg.inv(frame))
    if item.kind != "background":
        is_member = np.zeros(len(index), bool)
        is_member[kept] = highest_membership[index[kept]] >= item.threshold
        kept &= near_object(every.means, is_member)
    rows = index[kept]
    gaussians, detailed = every[kept], load_detailed(project, item.id)
    if detailed is not None:
        # Several Gaussians of detail may stand in place of one, and share its row.
        gaussians, places = detailed.with_detail(gaussians, rows)
        rows = rows[places]
    return gaussians, rows, membership[rows]


def add_object(scene: bpy.types.Scene, project: Path, item: ProjectObject, whole: bpy.types.Object) -> SplatScene:
    """Add an object of the project to `scene`, in a collection of its own, where it stands in the scene `whole`.

    Raises
    ------
    HeritageError
        When a file of the project cannot be read, or belongs to another version of the scene.
    """
    gaussians, index, membership = _object_gaussians(project, item, whole)
    members = gaussians.means[membership >= np.float32(item.threshold)]
    origin = bottom_middle(members) if len(members) and item.kind != "background" else np.zeros(3)
    # Where the transform of the whole scene was applied, so it is for the object.
    frame = frame_of_whole(whole)
    shift = frame[:3, :3] @ origin + frame[:3, 3]
    frame[:3, 3] -= shift
    collection = new_collection(scene.collection, item.name)
    splats = SplatScene.create(
        item.name, moved_gaussians(gaussians, frame), collection, index=index, membership=membership, frame=frame
    )
    obj = splats.object
    copy_world_matrix(obj, whole, shift)
    for key, value in placement_properties(whole).items():
        obj[key] = value
    properties: HeritageObject = obj.heritage
    record = load_record(project, item.id)
    with loading(properties):
        properties.role, properties.project, properties.object_id = "OBJECT", str(project), item.id
        properties.threshold = item.threshold
        for name, value in record.as_dict().items():
            setattr(properties, name, value)
    collection[ID_KEY] = item.id
    give_name(obj, item.name)
    obj.heritage_state.stored_name = item.name
    _write_object_properties(obj, project, item, whole)
    return SplatScene.of(obj)


def update_object(obj: bpy.types.Object, project: Path, item: ProjectObject, whole: bpy.types.Object) -> SplatScene:
    """Replace the Gaussians of `obj` by those of the project; its placement stays.

    Its name, threshold and record stay where the user has changed them since the project had the same.

    Raises
    ------
    HeritageError
        As `add_object`, and when the object is in Edit Mode.
    """
    splats = SplatScene.of(obj)
    gaussians, index, membership = _object_gaussians(project, item, whole)
    # Where the user has put the object, the Gaussians keep their place relative to its origin.
    frame = splats.frame
    splats.replace(moved_gaussians(gaussians, frame), index=index, membership=membership)
    state: HeritageState = obj.heritage_state
    if state.object_name == state.stored_name != item.name:
        give_name(obj, item.name)
        state.stored_name = item.name
    if obj.heritage.threshold == state.threshold:
        obj.heritage.threshold = item.threshold
    with loading(obj.heritage):
        for name, value in load_record(project, item.id).as_dict().items():
            if not getattr(obj.heritage, name):
                setattr(obj.heritage, name, value)
    _write_object_properties(obj, project, item, whole)
    return SplatScene.of(obj)


def _write_object_properties(
    obj: bpy.types.Object, project: Path, item: ProjectObject, whole: bpy.types.Object
) -> None:
    """Copy the description of an object in the project to its Blender object and collection."""
    properties: HeritageObject = obj.heritage
    with loading(properties):
        properties.prompt, properties.score, properties.kind = item.prompt, item.score, item.kind
        properties.n_levels, properties.level, properties.stored_level = item.n_levels, item.level, item.level
        properties.problem = ""
        properties.is_edited = False
    obj.heritage_state.state = state_of(path_within(project, "objects", item.id))
    obj.heritage_state.threshold = item.threshold
    obj[COUNT_KEY] = scene_count(whole)
    for collection in obj.users_collection:
        # Not the collections that the user added the object to.
        if collection.get(ID_KEY) == item.id:
            collection["heritage_prompt"] = item.prompt
            collection["heritage_score"] = item.score
