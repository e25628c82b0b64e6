"""Edits of isolated objects by hand: add and take Gaussians, split, merge, delete. The whole scene is never changed.

Edits stay in the .blend file, where Blender undoes them, until they are stored; see `not_stored`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.errors import ObjectError
from ...engine.objects.settings import DEFAULT_THRESHOLD
from ...engine.project.content import shown_objects
from ...engine.project.objects import load_membership
from ..blender.world_placement import copy_world_matrix
from ..splats.object_meshes import remove_meshes
from ..splats.properties import COUNT_KEY, loading, project_of, scene_count
from ..splats.selection import active_object, set_active_object
from ..splats.splats import SplatScene
from .object_geometry import moved_gaussians
from .object_import import new_collection
from .object_names import ID_KEY, give_new_name
from .placement import frame_of_whole, placement_properties
from .scene_file import whole_scene

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
    rows = splats.index(scene_count(obj))
    return rows[(rows >= 0) & splats.shown]


def add_rows(obj: bpy.types.Object, rows: NDArray[np.integer], whole: bpy.types.Object) -> int:
    """Add Gaussians of the scene to an isolated object and return how many were not part of it before.

    Parameters
    ----------
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
        there = splats.frame @ np.linalg.inv(frame_of_whole(whole))
        joined = splats.local_gaussians().joined(moved_gaussians(source.local_gaussians()[copied], there))
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
    before = splats.shown
    # Where detail was added, several Gaussians stand for one of the scene: they leave together, as they are stored.
    rows = splats.index(scene_count(obj))
    vertices = np.flatnonzero(
        np.isin(rows, rows[vertices][rows[vertices] >= 0]) | np.isin(np.arange(len(rows)), vertices)
    )
    after = before.copy()
    after[vertices] = False
    if not after.any():
        raise ObjectError(f"Nothing would be left of {obj.name}. Delete the object instead.")
    membership[vertices] = _OUT
    splats.set_membership(membership)
    _mark(obj)
    return int(before.sum() - after.sum())


def new_object(
    scene: bpy.types.Scene, name: str, vertices: NDArray[np.integer], source: bpy.types.Object
) -> SplatScene:
    """Add an isolated object made of the Gaussians at `vertices` [K] of splats, which stand where they stand there.

    Raises
    ------
    ObjectError
        When no Gaussian of the project's scene is among them.
    """
    splats = SplatScene.of(source)
    index = splats.index(scene_count(source))
    kept = vertices[index[vertices] >= 0]
    if not len(kept):
        raise ObjectError("Nothing is selected that a new object could be made of.")
    collection = new_collection(scene.collection, name)
    gaussians, frame = splats.local_gaussians()[kept], splats.frame
    membership = np.full(len(kept), _IN, np.float32)
    splats = SplatScene.create(name, gaussians, collection, index=index[kept], membership=membership, frame=frame)
    obj = splats.object
    copy_world_matrix(obj, source)
    obj[COUNT_KEY] = scene_count(source)
    for key, value in placement_properties(source).items():
        obj[key] = value
    with loading(obj.heritage):
        obj.heritage.role, obj.heritage.project = "OBJECT", source.heritage.project
        obj.heritage.kind, obj.heritage.prompt, obj.heritage.score = "hand", "made by hand", 1.0
        obj.heritage.threshold = DEFAULT_THRESHOLD
    collection[ID_KEY] = ""
    give_new_name(obj, name)
    _mark(obj)
    return SplatScene.of(obj)


def merge_objects(target: bpy.types.Object, others: Sequence[bpy.types.Object], scene: bpy.types.Scene) -> int:
    """Add the Gaussians of `others` to `target`, delete the others, and return how many Gaussians are new in it.

    Raises
    ------
    ObjectError
        When the objects belong to different projects.
    """
    whole = whole_of(target, scene)
    if any(project_of(other.heritage) != project_of(target.heritage) for other in others):
        raise ObjectError("Objects of different projects cannot be merged. Select objects of one project.")
    added = add_rows(target, np.concatenate([member_rows(other) for other in others]), whole)
    for other in others:
        delete_object(other)
    return added


def delete_object(obj: bpy.types.Object) -> None:
    """Delete an isolated object and its mesh from the file. Undo brings them back; the project has the object still."""
    remove_meshes(obj)
    collections, mesh = list(obj.users_collection), obj.data
    bpy.data.objects.remove(obj)
    if mesh.users == 0:
        bpy.data.meshes.remove(mesh)
    for collection in collections:
        if collection in bpy.data.collections.values() and not collection.all_objects:
            bpy.data.collections.remove(collection)


def was_edited_meanwhile(obj: bpy.types.Object, project: Path) -> bool:
    """Return whether `obj` has edits that the job has not stored which has just made it in `project` again.

    Raises
    ------
    FormatError
        When a file of the project cannot be read.
    """
    if not obj.heritage.is_edited:
        return False
    item = next((one for one in shown_objects(project) if one.id == obj.heritage.object_id), None)
    if item is None:
        return True
    stored = load_membership(project, item.id, scene_count(obj)) >= np.float32(item.threshold)
    return not np.array_equal(np.unique(member_rows(obj)), np.flatnonzero(stored))


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
