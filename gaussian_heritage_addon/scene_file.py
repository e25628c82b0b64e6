"""Imports a project folder into a Blender scene: the splats, the cameras, and a collection for each object."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..engine.files import path_within
from ..engine.formats import read_ply
from ..engine.records import load_record
from ..engine.scene import Gaussians, load_polished, read_camera_set
from .cameras import add_cameras, look_through
from .project import ProjectObject, list_objects, load_level, load_membership, require_intact, scene_file
from .properties import (
    COUNT_KEY,
    HeritageObject,
    apply_blending,
    apply_visibility,
    heritage_objects,
    loading,
    project_of,
    scene_count,
)
from .splats import SplatScene

__all__ = ["add_objects", "add_splat_file", "open_project", "prepare_cycles", "whole_scene"]

_INITIAL_RENDER_SIDE = 1280
"""Longest side of renders in pixels, as set on import. Cycles is slow at the full size of a photo."""
_MIN_COPIED_MEMBERSHIP = 0.05
"""Smallest membership of Gaussians that are copied into an object, unless its threshold is lower.

Setting the threshold below it shows no more Gaussians."""
_OBJECT_ID_KEY = "heritage_object_id"
"""Custom property of an object's own collection: the id of the object."""


def add_splat_file(scene: bpy.types.Scene, file: Path, name: str, *, skip_broken: bool = False) -> SplatScene:
    """Import the Gaussian PLY `file` into `scene` as an object called `name`."""
    gaussians = read_ply(file, skip_broken=skip_broken)
    splats = SplatScene.create(name, gaussians, scene.collection)
    splats.object.heritage.role = "SCENE"
    splats.object[COUNT_KEY] = len(gaussians)
    apply_blending(scene)
    apply_visibility(scene)
    return splats


def open_project(scene: bpy.types.Scene, project: Path, *, with_cameras: bool = True) -> SplatScene:
    """Import a project folder into `scene`: splats, cameras and objects.

    Parameters
    ----------
    scene : Scene
    project : Path
    with_cameras : bool
        Add the cameras of the photos. The first becomes the scene camera if there is none.

    Returns
    -------
    SplatScene
        The whole scene. Blending is set to ``"TRAINED"`` if the Blender scene had no splats.

    Raises
    ------
    HeritageError
        When the project has no finished scene, or one of its files cannot be read.
    """
    project = project.absolute()
    file = scene_file(project)
    objects = list_objects(project)
    camera_folder = path_within(project, "cameras")
    has_cameras = (camera_folder / "cameras.json").exists()
    camera_set = read_camera_set(camera_folder) if with_cameras and has_cameras else None
    if not heritage_objects(scene):
        # With splats in the scene, the setting is the user's choice.
        scene.heritage.blending = "TRAINED"
    splats = add_splat_file(scene, file, _title(project))
    splats.object.heritage.project = str(project)
    scene.heritage.project = str(project)
    if camera_set is not None:
        collection = _new_collection(scene.collection, f"{_title(project)} Cameras")
        add_cameras(camera_set.cameras, collection)
        if scene.camera is None and camera_set.cameras:
            look_through(scene, "", _INITIAL_RENDER_SIDE)
    prepare_cycles(scene)
    add_objects(scene, project, [item.id for item in objects])
    return splats


def _title(project: Path) -> str:
    return project.name.removesuffix("_heritage") or project.name


def _new_collection(parent: bpy.types.Collection, name: str) -> bpy.types.Collection:
    collection = bpy.data.collections.new(name)
    parent.children.link(collection)
    return collection


def add_objects(scene: bpy.types.Scene, project: Path, ids: Iterable[str]) -> list[SplatScene]:
    """Add or update the objects `ids` of the project. Each has a collection with its own splats.

    Returns
    -------
    list of SplatScene
        Sorted by name. An updated object keeps its name, collection, placement, threshold and record.

    Raises
    ------
    HeritageError
        When a file of the project cannot be read, or an object to update is in Edit Mode.

    Notes
    -----
    Each object gets a copy of all Gaussians of the scene that any of its levels needs. The sliders then only change
    which of them are drawn and exported. Gaussians that the engine has polished, those of the object at its stored
    level and threshold, are imported in their polished form, except where they were moved by hand. All others are
    copied from the scene with its edits.
    """
    present = {obj.heritage.object_id: obj for obj in heritage_objects(scene, "OBJECT") if _belongs_to(obj, project)}
    id_set = set(ids)
    items = [item for item in list_objects(project) if item.id in id_set]
    if not items:
        return []
    whole = whole_scene(scene, project)
    if whole is None:
        whole = add_splat_file(scene, scene_file(project), _title(project)).object
        whole.heritage.project = str(project)
    splats = [
        _update_object(present[item.id], project, item, whole)
        if item.id in present
        else _add_object(scene, project, item, whole)
        for item in items
    ]
    apply_blending(scene)
    apply_visibility(scene)
    return splats


def whole_scene(scene: bpy.types.Scene, project: Path) -> bpy.types.Object | None:
    """Return the splats of the whole scene of `project`; None when they were deleted or not imported."""
    return next((obj for obj in heritage_objects(scene, "SCENE") if _belongs_to(obj, project)), None)


def _belongs_to(obj: bpy.types.Object, project: Path) -> bool:
    return bool(obj.heritage.project) and project_of(obj.heritage) == project


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
    rows = index[kept]
    gaussians, polished = source.local_gaussians()[kept], load_polished(project, item.id)
    return gaussians if polished is None else polished.with_polished(gaussians, rows), rows, membership[rows]


def _add_object(scene: bpy.types.Scene, project: Path, item: ProjectObject, whole: bpy.types.Object) -> SplatScene:
    gaussians, index, membership = _object_gaussians(project, item, whole)
    collection = _new_collection(scene.collection, item.name)
    splats = SplatScene.create(item.name, gaussians, collection, index=index, membership=membership)
    obj = splats.object
    obj.matrix_world = whole.matrix_world
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


def _update_object(obj: bpy.types.Object, project: Path, item: ProjectObject, whole: bpy.types.Object) -> SplatScene:
    splats = SplatScene.of(obj)
    gaussians, index, membership = _object_gaussians(project, item, whole)
    splats.replace(gaussians, index=index, membership=membership)
    _write_object_properties(obj, item, whole)
    return splats


def _write_object_properties(obj: bpy.types.Object, item: ProjectObject, whole: bpy.types.Object) -> None:
    """Copy the description of an object in the project to its Blender object and collection."""
    properties: HeritageObject = obj.heritage
    with loading(properties):
        properties.prompt, properties.score, properties.kind = item.prompt, item.score, item.kind
        properties.n_levels, properties.level, properties.stored_level = item.n_levels, item.level, item.level
        properties.problem = ""
    obj[COUNT_KEY] = scene_count(whole)
    for collection in obj.users_collection:
        # Not the collections that the user added the object to.
        if collection.get(_OBJECT_ID_KEY) == item.id:
            collection["heritage_prompt"] = item.prompt
            collection["heritage_score"] = item.score


def prepare_cycles(scene: bpy.types.Scene) -> None:
    """Set up Cycles to draw splats as the engine does, with one ray through the centre of each pixel.

    Notes
    -----
    Splats need one sample; other objects in the scene need more, and a wider pixel filter. A ray ends after 256
    Gaussians. Cycles must not end rays at random earlier: that leaves white specks. See docs/design_notes/blender.md.
    """
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.transparent_max_bounces = 256
    cycles.min_transparent_bounces = 256
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.samples = cycles.preview_samples = 1
