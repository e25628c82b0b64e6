"""Edits of isolated objects by hand: add and take Gaussians, split, merge, delete. The whole scene is never changed.

Edits stay in the .blend file, where Blender undoes them, until `store_arguments` are given to the engine.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..engine.errors import ObjectError
from ..engine.files import atomic_write
from ..engine.project_content import list_objects
from ..engine.records import new_id
from .object_import import new_collection, origin_in_scene
from .placement import placement_properties
from .preferences import user_folder
from .properties import COUNT_KEY, active_object, heritage_objects, loading, project_of, scene_count, set_active_object
from .scene_file import whole_scene
from .splats import SplatScene

__all__ = [
    "add_rows",
    "delete_object",
    "edited_objects",
    "member_rows",
    "merge_objects",
    "new_object",
    "object_mode",
    "store_arguments",
    "take_vertices",
    "whole_of",
]

_IN, _OUT = 1.0, 0.0
"""Memberships that are set by hand: every threshold above 0 agrees with them."""


def whole_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Object:
    """Return the whole scene that the object belongs to.

    Raises
    ------
    ObjectError
        When it is not in the file.
    """
    whole = whole_scene(scene, project_of(obj.heritage)) if obj.heritage.project else None
    if whole is None:
        raise ObjectError(f"The whole scene of {obj.name} is not in this file. Open the project again.")
    return whole


def member_rows(obj: bpy.types.Object) -> NDArray[np.int32]:
    """Return the rows, in the project's scene, of the Gaussians that an isolated object shows at its threshold."""
    splats = SplatScene.of(obj)
    rows, membership = splats.index(scene_count(obj)), splats.membership
    shown = rows >= 0 if membership is None else (rows >= 0) & (membership >= np.float32(obj.heritage.threshold))
    return rows[shown]


def add_rows(obj: bpy.types.Object, rows: NDArray[np.integer], whole: bpy.types.Object) -> int:
    """Add Gaussians of the scene to an isolated object and return how many were not part of it before.

    Parameters
    ----------
    obj : Object
    rows : array of shape [K]
        Rows in the project's scene.
    whole : Object
        The whole scene, from which the Gaussians are copied; it is not changed.

    Raises
    ------
    ObjectError
        When a splat object was changed by another program, or the object is in Edit Mode.
    """
    splats, source = SplatScene.of(obj), SplatScene.of(whole)
    count = scene_count(whole)
    own, membership = splats.index(count), splats.membership
    membership = np.ones(len(own), np.float32) if membership is None else membership
    before = len(np.unique(member_rows(obj)))
    wanted = np.zeros(count, bool)
    wanted[rows[rows >= 0]] = True
    membership[(own >= 0) & wanted[own]] = _IN
    wanted[own[own >= 0]] = False
    index = source.index(count)
    copied = np.flatnonzero((index >= 0) & wanted[index])
    if len(copied):
        new = source.local_gaussians()[copied]
        means = (new.means - origin_in_scene(splats, whole)).astype(np.float32)
        joined = splats.local_gaussians().joined(replace(new, means=means))
        membership = np.concatenate([membership, np.full(len(copied), _IN, np.float32)])
        splats.replace(joined, index=np.concatenate([own, index[copied]]), membership=membership)
    else:
        splats.set_membership(membership)
    _mark(obj)
    return len(np.unique(member_rows(obj))) - before


def take_vertices(obj: bpy.types.Object, vertices: NDArray[np.integer]) -> int:
    """Take the Gaussians at `vertices` [K] from an isolated object and return how many were part of it before.

    Raises
    ------
    ObjectError
        When nothing would be left, and as `add_rows`.
    """
    splats = SplatScene.of(obj)
    membership = splats.membership
    membership = np.ones(len(obj.data.vertices), np.float32) if membership is None else membership
    threshold = np.float32(obj.heritage.threshold)
    before = membership >= threshold
    after = before.copy()
    after[vertices] = False
    if not after.any():
        raise ObjectError(f"Nothing would be left of {obj.name}. Delete the object instead.")
    membership[vertices] = _OUT
    splats.set_membership(membership)
    _mark(obj)
    return int(before.sum() - after.sum())


def new_object(scene: bpy.types.Scene, name: str, rows: NDArray[np.integer], whole: bpy.types.Object) -> SplatScene:
    """Add an isolated object made of `rows` [K] of the project's scene, where they are in `whole`.

    Raises
    ------
    ObjectError
        When no row is given.
    """
    source = SplatScene.of(whole)
    index = source.index(scene_count(whole))
    kept = np.flatnonzero((index >= 0) & np.isin(index, rows))
    if not len(kept):
        raise ObjectError("Nothing is selected that a new object could be made of.")
    collection = new_collection(scene.collection, name)
    membership = np.full(len(kept), _IN, np.float32)
    splats = SplatScene.create(
        name, source.local_gaussians()[kept], collection, index=index[kept], membership=membership
    )
    obj = splats.object
    obj.matrix_world = whole.matrix_world
    obj[COUNT_KEY] = scene_count(whole)
    for key, value in placement_properties(whole).items():
        obj[key] = value
    with loading(obj.heritage):
        obj.heritage.role, obj.heritage.project = "OBJECT", whole.heritage.project
        obj.heritage.kind, obj.heritage.prompt, obj.heritage.score = "hand", "made by hand", 1.0
        obj.heritage.threshold = 0.5
    _mark(obj)
    return splats


def merge_objects(target: bpy.types.Object, others: Sequence[bpy.types.Object], scene: bpy.types.Scene) -> int:
    """Add the Gaussians of `others` to `target`, delete the others, and return how many Gaussians are new in it."""
    whole = whole_of(target, scene)
    if any(project_of(other.heritage) != project_of(target.heritage) for other in others):
        raise ObjectError("Objects of different projects cannot be merged. Select objects of one project.")
    added = add_rows(target, np.concatenate([member_rows(other) for other in others]), whole)
    for other in others:
        delete_object(other, scene)
    return added


def delete_object(obj: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Delete an isolated object from the file, and note it for the project. Blender's undo brings it back."""
    if obj.heritage.object_id:
        scene.heritage.deleted = "\n".join([*filter(None, scene.heritage.deleted.split("\n")), obj.heritage.object_id])
    collections, mesh = list(obj.users_collection), obj.data
    bpy.data.objects.remove(obj)
    if mesh.users == 0:
        bpy.data.meshes.remove(mesh)
    for collection in collections:
        if collection in bpy.data.collections.values() and not collection.all_objects:
            bpy.data.collections.remove(collection)


def edited_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the objects of `scene` with edits that are not stored in the project."""
    return [obj for obj in heritage_objects(scene, "OBJECT") if obj.heritage.is_edited]


def store_arguments(scene: bpy.types.Scene) -> list[str]:
    """Write what was edited to files, and return the arguments of the engine's ``edit`` that store it in the project.

    New objects get their ids.

    Raises
    ------
    ObjectError
        When nothing was edited.
    DiskError
        When a file cannot be written.
    """
    project = project_of(scene.heritage)
    edited = [obj for obj in edited_objects(scene) if project_of(obj.heritage) == project]
    deleted = [one for one in scene.heritage.deleted.split("\n") if one]
    if not edited and not deleted:
        raise ObjectError("No object was edited by hand since the project was opened.")
    known = [item.id for item in list_objects(project)]
    folder = user_folder("edits") / f"{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
    arguments = [f"--delete={object_id}" for object_id in deleted if object_id in known]
    taken = [*known, *(obj.heritage.object_id for obj in edited if obj.heritage.object_id)]
    for obj in edited:
        if not obj.heritage.object_id:
            with loading(obj.heritage):
                obj.heritage.object_id = new_id(obj.name, taken)
            taken.append(obj.heritage.object_id)
            arguments.append(f"--rename={obj.heritage.object_id}={obj.name}")
        file = folder / f"{len(arguments)}.npy"
        _write_membership(file, obj)
        arguments.append(f"--set={obj.heritage.object_id}={file}")
    return arguments


def _write_membership(file: Path, obj: bpy.types.Object) -> None:
    splats, count = SplatScene.of(obj), scene_count(obj)
    rows, membership = splats.index(count), splats.membership
    stored = np.zeros(count, np.float32)
    values = np.ones(len(rows), np.float32) if membership is None else membership
    known = rows >= 0
    np.maximum.at(stored, rows[known], values[known])
    with atomic_write(file) as stream:
        np.save(stream, np.clip(stored, 0.0, 1.0), allow_pickle=False)


def _mark(obj: bpy.types.Object) -> None:
    obj.heritage.is_edited = True


@contextlib.contextmanager
def object_mode() -> Iterator[None]:
    """Leave Edit Mode for this block, in which meshes are changed, and return to it."""
    scene, layer = bpy.context.scene, bpy.context.view_layer
    active = layer.objects.active
    edited = active.name if active is not None and active.mode == "EDIT" else ""
    listed = active_object(scene)
    former = listed.name if listed is not None else ""
    if edited:
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        # The block may have deleted it, or selected another one.
        if edited in layer.objects:
            now = active_object(scene)
            chosen = now.name if now is not None and now.name != edited else former
            layer.objects[edited].select_set(True)
            layer.objects.active = layer.objects[edited]
            bpy.ops.object.mode_set(mode="EDIT")
            # In Edit Mode, the list has the object that edits are meant for.
            set_active_object(scene, scene.objects.get(chosen))
