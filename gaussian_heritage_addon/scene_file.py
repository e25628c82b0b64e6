"""A project folder as a Blender scene: the splats, the cameras, and a collection for each object."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..engine.formats import read_ply
from ..engine.records import load_record
from ..engine.scene import Gaussians, load_polished, read_camera_set
from .cameras import add_cameras, look_through
from .project import ProjectObject, list_objects, load_level, load_membership, scene_file
from .properties import apply_blending, heritage_objects, show_parts
from .splats import SplatScene

__all__ = ["add_objects", "add_splat_file", "open_project", "prepare_cycles", "whole_scene"]

_LONGEST_SIDE = 1280
"""Of a first render: a photo's own size would take Cycles long."""
_LOOSEST = 0.05
"""Lowest membership whose Gaussians are copied: the slider goes no further down."""


def add_splat_file(scene: bpy.types.Scene, file: Path, name: str, *, skip_broken: bool = False) -> SplatScene:
    """Import the Gaussian PLY `file` into `scene` as an object called `name`."""
    gaussians = read_ply(file, skip_broken=skip_broken)
    splats = SplatScene.create(name, gaussians, scene.collection)
    splats.object.heritage.role = "SCENE"
    # The mesh may be edited; memberships belong to the scene as it was read.
    splats.object["heritage_count"] = len(gaussians)
    apply_blending(scene)
    show_parts(scene)
    return splats


def open_project(scene: bpy.types.Scene, project: Path, *, with_cameras: bool = True) -> SplatScene:
    """Bring the project folder into `scene`: splats, cameras, and its objects.

    Parameters
    ----------
    scene : Scene
    project : Path
    with_cameras : bool
        Add the cameras of the photos; the first becomes the scene's when it has none.

    Returns
    -------
    SplatScene
        The whole scene, blended as trained when these are the first splats here.

    Raises
    ------
    HeritageError
        When the project has no finished scene, or a file of it cannot be read.
    """
    file = scene_file(project)
    objects = list_objects(project)
    camera_file = project / "cameras"
    camera_set = read_camera_set(camera_file) if with_cameras and (camera_file / "cameras.json").is_file() else None
    if not heritage_objects(scene):
        # Else the person has chosen already.
        scene.heritage.blending = "TRAINED"
    splats = add_splat_file(scene, file, _title(project))
    splats.object.heritage.project = str(project)
    scene.heritage.project = str(project)
    if camera_set is not None:
        collection = _new_collection(scene.collection, f"{_title(project)} Cameras")
        add_cameras(camera_set.cameras, collection)
        collection.hide_viewport = True
        if scene.camera is None and camera_set.cameras:
            look_through(scene, "", _LONGEST_SIDE)
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
    """Give each object of the project in `ids` a collection with its own splats; those in the scene are made anew.

    Returns
    -------
    list of SplatScene
        By name. One that was in the scene keeps its object, with name, collection, placement, threshold and record.

    Raises
    ------
    HeritageError
        When a file of the project cannot be read, or such an object is in Edit Mode.

    Notes
    -----
    The rows are copied once from the scene's splats, as many as any level needs; the sliders then only change which of
    them are drawn and exported. What the engine has polished, the object at its stored level and threshold, comes in
    its polished form, but for what was moved by hand; what the sliders add comes as it is in the scene, edits included.
    """
    present = {obj.heritage.object_id: obj for obj in heritage_objects(scene, "OBJECT") if _of(obj, project)}
    chosen = set(ids)
    wanted = [item for item in list_objects(project) if item.id in chosen]
    if not wanted:
        return []
    whole = whole_scene(scene, project)
    if whole is None:
        whole = add_splat_file(scene, scene_file(project), _title(project)).object
        whole.heritage.project = str(project)
    made = [
        _update_object(present[item.id], project, item, whole)
        if item.id in present
        else _add_object(scene, project, item, whole)
        for item in wanted
    ]
    apply_blending(scene)
    show_parts(scene)
    return made


def whole_scene(scene: bpy.types.Scene, project: Path) -> bpy.types.Object | None:
    """Return the splats of the whole scene of `project`; None when they were deleted or never imported."""
    return next((obj for obj in heritage_objects(scene, "SCENE") if _of(obj, project)), None)


def _of(obj: bpy.types.Object, project: Path) -> bool:
    return Path(obj.heritage.project) == project


def _rows_of(
    project: Path, item: ProjectObject, whole: bpy.types.Object
) -> tuple[Gaussians, NDArray[np.int32], NDArray[np.float32]]:
    """Return the object's Gaussians, their rows in the project's scene, and their membership at its level."""
    source, count = SplatScene.of(whole), whole["heritage_count"]
    index = source.index
    membership = load_membership(project, item.id, count)
    loosest = membership
    if item.n_levels > 1:
        levels = [load_level(project, item.id, level, count) for level in range(item.n_levels)]
        loosest = np.max([membership, *levels], axis=0)
    # Hand-made Gaussians (-1) belong to no object.
    kept = (index >= 0) & (loosest[index] >= min(_LOOSEST, item.threshold))
    rows = index[kept]
    gaussians, polished = source.local_gaussians()[kept], load_polished(project, item.id)
    return gaussians if polished is None else polished.with_polished(gaussians, rows), rows, membership[rows]


def _add_object(scene: bpy.types.Scene, project: Path, item: ProjectObject, whole: bpy.types.Object) -> SplatScene:
    gaussians, index, membership = _rows_of(project, item, whole)
    collection = _new_collection(scene.collection, item.name)
    splats = SplatScene.create(item.name, gaussians, collection, index=index, membership=membership)
    obj = splats.object
    obj.matrix_world = whole.matrix_world
    said, record = obj.heritage, load_record(project, item.id)
    said.is_loading = True
    said.role, said.project, said.object_id, said.threshold = "OBJECT", str(project), item.id, item.threshold
    for name, value in record.as_dict().items():
        setattr(said, name, value)
    said.is_loading = False
    collection["heritage_object_id"] = item.id
    _tell_of(obj, item, whole)
    return splats


def _update_object(obj: bpy.types.Object, project: Path, item: ProjectObject, whole: bpy.types.Object) -> SplatScene:
    splats = SplatScene.of(obj)
    gaussians, index, membership = _rows_of(project, item, whole)
    splats.replace(gaussians, index=index, membership=membership)
    _tell_of(obj, item, whole)
    return splats


def _tell_of(obj: bpy.types.Object, item: ProjectObject, whole: bpy.types.Object) -> None:
    """Write what the project knows of an object onto it and its collection."""
    said = obj.heritage
    said.is_loading = True
    said.prompt, said.score, said.kind = item.prompt, item.score, item.kind
    said.n_levels, said.level, said.stored_level = item.n_levels, item.level, item.level
    said.problem = ""
    said.is_loading = False
    obj["heritage_count"] = whole["heritage_count"]
    for collection in obj.users_collection:
        # Others that the person put it into are theirs.
        if collection.get("heritage_object_id") == item.id:
            collection["heritage_prompt"] = item.prompt
            collection["heritage_score"] = item.score


def prepare_cycles(scene: bpy.types.Scene) -> None:
    """Set Cycles so that it draws splats as the engine does: one ray through the middle of each pixel.

    Notes
    -----
    Splats need no more samples; raise them (and the filter's width) when other objects join the scene. A ray ends after
    256 Gaussians: on a real scene (90,000 Gaussians) that changes a pixel by 10/255 at most and by 0.004/255 on average
    against 1,024, in 40 % of the time. Letting Cycles end faint rays by chance earlier leaves white specks.
    """
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.transparent_max_bounces = 256
    cycles.min_transparent_bounces = 256
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.samples = 1
