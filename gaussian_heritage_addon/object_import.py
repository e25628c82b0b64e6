"""Objects of a project as Blender objects: their Gaussians, copied from the scene, with the origin at their foot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..engine.project_content import ProjectObject, load_level, load_membership, require_intact
from ..engine.records import load_record
from ..engine.scene import Gaussians, load_polished
from .object_geometry import foot_of, near_object
from .placement import placement_properties
from .properties import COUNT_KEY, HeritageObject, loading, scene_count
from .splats import SplatScene
from .world_placement import copy_world_matrix

__all__ = ["add_object", "new_collection", "origin_in_scene", "update_object"]

_MIN_COPIED_MEMBERSHIP = 0.05
"""Smallest membership of Gaussians that are copied into an object, unless its threshold is lower.

Setting the threshold below it shows no more Gaussians."""
_OBJECT_ID_KEY = "heritage_object_id"
"""Custom property of an object's own collection: the id of the object."""


def new_collection(parent: bpy.types.Collection, name: str) -> bpy.types.Collection:
    """Return a new collection in `parent`. Blender adds a number if the name is in use."""
    collection = bpy.data.collections.new(name)
    parent.children.link(collection)
    return collection


def _object_gaussians(
    project: Path, item: ProjectObject, whole: bpy.types.Object
) -> tuple[Gaussians, NDArray[np.int32], NDArray[np.float32]]:
    """Return the Gaussians of an object, their rows in the project's scene, and their memberships at its level."""
    source, count = SplatScene.of(whole), scene_count(whole)
    index = source.index(count)
    require_intact(project, item.id)
    membership = load_membership(project, item.id, count)
    highest_membership = membership
    if item.n_levels > 1:
        levels = [load_level(project, item.id, level, count) for level in range(item.n_levels)]
        highest_membership = np.max([membership, *levels], axis=0)
    # Gaussians added by hand (-1) belong to no object.
    kept = (index >= 0) & (highest_membership[index] >= min(_MIN_COPIED_MEMBERSHIP, item.threshold))
    every = source.local_gaussians()
    if item.kind != "background":
        is_member = np.zeros(len(index), bool)
        is_member[kept] = highest_membership[index[kept]] >= item.threshold
        kept &= near_object(every.means, is_member)
    rows = index[kept]
    gaussians, polished = every[kept], load_polished(project, item.id)
    return gaussians if polished is None else polished.with_polished(gaussians, rows), rows, membership[rows]


def add_object(scene: bpy.types.Scene, project: Path, item: ProjectObject, whole: bpy.types.Object) -> SplatScene:
    """Add an object of the project to `scene`, in a collection of its own, where it stands in the scene `whole`.

    Raises
    ------
    HeritageError
        When a file of the project cannot be read, or belongs to another version of the scene.
    """
    gaussians, index, membership = _object_gaussians(project, item, whole)
    members = gaussians.means[membership >= np.float32(item.threshold)]
    foot = foot_of(members) if len(members) and item.kind != "background" else np.zeros(3)
    collection = new_collection(scene.collection, item.name)
    splats = SplatScene.create(item.name, _moved(gaussians, -foot), collection, index=index, membership=membership)
    obj = splats.object
    copy_world_matrix(obj, whole, foot)
    for key, value in placement_properties(whole).items():
        obj[key] = value
    properties: HeritageObject = obj.heritage
    record = load_record(project, item.id)
    with loading(properties):
        properties.role, properties.project, properties.object_id = "OBJECT", str(project), item.id
        properties.threshold = item.threshold
        for name, value in record.as_dict().items():
            setattr(properties, name, value)
    collection[_OBJECT_ID_KEY] = item.id
    _write_object_properties(obj, item, whole)
    return splats


def update_object(obj: bpy.types.Object, project: Path, item: ProjectObject, whole: bpy.types.Object) -> SplatScene:
    """Replace the Gaussians of `obj` by those of the project; its name, placement, threshold and record stay.

    Raises
    ------
    HeritageError
        As `add_object`, and when the object is in Edit Mode.
    """
    splats = SplatScene.of(obj)
    gaussians, index, membership = _object_gaussians(project, item, whole)
    # Where the user has put the object, the Gaussians keep their place relative to its origin.
    splats.replace(_moved(gaussians, -origin_in_scene(splats, whole)), index=index, membership=membership)
    _write_object_properties(obj, item, whole)
    return splats


def _write_object_properties(obj: bpy.types.Object, item: ProjectObject, whole: bpy.types.Object) -> None:
    """Copy the description of an object in the project to its Blender object and collection."""
    properties: HeritageObject = obj.heritage
    with loading(properties):
        properties.prompt, properties.score, properties.kind = item.prompt, item.score, item.kind
        properties.n_levels, properties.level, properties.stored_level = item.n_levels, item.level, item.level
        properties.problem = ""
        properties.is_edited = False
    obj[COUNT_KEY] = scene_count(whole)
    for collection in obj.users_collection:
        # Not the collections that the user added the object to.
        if collection.get(_OBJECT_ID_KEY) == item.id:
            collection["heritage_prompt"] = item.prompt
            collection["heritage_score"] = item.score


def _moved(gaussians: Gaussians, by: NDArray[np.float64]) -> Gaussians:
    return replace(gaussians, means=(gaussians.means + by).astype(np.float32))


def origin_in_scene(splats: SplatScene, whole: bpy.types.Object) -> NDArray[np.float64]:
    """Return the origin of an object in the frame of the scene.

    Found from its Gaussians, as objects of older files have the origin of the scene, and *Object > Set Origin* moves
    it. The median, because single Gaussians may be polished or moved by hand.
    """
    scene = SplatScene.of(whole)
    count = scene_count(whole)
    rows, scene_rows = splats.index(count), scene.index(count)
    places = np.full(count, -1)
    places[scene_rows[scene_rows >= 0]] = np.flatnonzero(scene_rows >= 0)
    known = np.flatnonzero(rows >= 0)
    known = known[places[rows[known]] >= 0]
    if not len(known):
        return np.zeros(3)
    differences = scene.local_gaussians().means[places[rows[known]]] - splats.local_gaussians().means[known]
    return np.median(differences.astype(np.float64), axis=0)
