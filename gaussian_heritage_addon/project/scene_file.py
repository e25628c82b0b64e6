"""Imports a project folder into a Blender scene: the splats, the cameras, and a collection for each object."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ...engine.core.errors import FormatError
from ...engine.core.files import path_within
from ...engine.delivery.records import scene_title
from ...engine.formats import ANTIALIASED_NOTE, Up, file_from_z_up, kind_of, read_other, read_ply, read_ply_file
from ...engine.project.content import scene_file, shown_objects
from ...engine.project.folder import ProjectFolder
from ...engine.scene import CameraSet, Measurement, load_measurement, read_camera_set
from ..blender.default_objects import hide_untouched_defaults
from ..blender.world_placement import set_world_matrix, world_matrix
from ..splats.display_settings import apply_display, choose_display
from ..splats.properties import COUNT_KEY, apply_blending, apply_visibility, photo_of, project_of
from ..splats.render_settings import is_untouched, set_up_render
from ..splats.selection import active_object, heritage_objects, set_active_object
from ..splats.sog_pictures import decode_picture
from ..splats.splat_view import is_software
from ..splats.splats import SplatScene
from ..splats.stored_file import keep_file
from .cameras import INITIAL_RENDER_SIDE, add_cameras, look_through
from .object_geometry import moved_gaussians
from .object_import import add_object, new_collection, update_object
from .object_state import add_known, mark_copies, owners
from .placement import apply_measurement, frame_of_whole, placement_properties


def add_splat_file(
    scene: bpy.types.Scene, file: Path, name: str, frame: NDArray[np.float64] | None = None
) -> SplatScene:
    """Import the Gaussian PLY `file` of a project into `scene` as an object called `name`.

    `frame`, [4, 4], takes the engine's world to that of the mesh; None: they are the same.
    """
    gaussians = read_ply(file)
    moved = gaussians if frame is None else moved_gaussians(gaussians, frame)
    splats = SplatScene.create(name, moved, scene.collection, frame=frame)
    _show(scene, splats, len(gaussians))
    return splats


def add_other_file(
    scene: bpy.types.Scene,
    file: Path,
    name: str,
    *,
    up: Up | None = None,
    skip_broken: bool = False,
    tell: Callable[[str], None] | None = None,
) -> SplatScene:
    """Import the Gaussians of a file of any program as an object called `name` that stands upright.

    The numbers of a PLY stay as they are, also those that mean nothing here; the object is turned. What is taken off
    double coordinates far from 0, such as UTM, becomes the object's location.

    Parameters
    ----------
    up : {"z", "-y", "y"}, optional
        Axis of the file that points up. None: what a PLY states, Y for SPZ, otherwise -Y, as in the files of most
        programs. GLB defines it.
    skip_broken : bool
        See `read_ply_file`; of a PLY alone.
    tell : callable, optional
        Called with each sentence that the user should know of how the file was read.

    Raises
    ------
    FormatError
        When the file has no format that is read, has no Gaussians, or cannot be read.
    """
    kind = kind_of(file)
    if kind != "ply":
        gaussians = read_other(file, kind, decode_picture, up=up)
        if not len(gaussians):
            raise FormatError(f"{file} has no Gaussians. Choose another file.")
        splats = SplatScene.create(name, gaussians, scene.collection)
        _show(scene, splats, len(gaussians))
        if tell is not None and gaussians.antialiased:
            tell(ANTIALIASED_NOTE)
        return splats
    content = read_ply_file(file, skip_broken=skip_broken)
    up = up or content.up or ("z" if content.is_ours else "-y")
    splats = SplatScene.create(name, content.gaussians, scene.collection)
    upright = Matrix(file_from_z_up(up).T.tolist())
    set_world_matrix(splats.object, np.array(upright @ Matrix.Translation(content.origin)))
    keep_file(splats.object, content, up)
    _show(scene, splats, len(content.gaussians))
    if tell is not None:
        for note in content.notes:
            tell(note)
    return splats


def _show(scene: bpy.types.Scene, splats: SplatScene, count: int) -> None:
    if not heritage_objects(scene):
        hide_untouched_defaults(scene)
    splats.object.heritage.role = "SCENE"
    splats.object[COUNT_KEY] = count
    apply_blending(scene)
    apply_visibility(scene)
    apply_display(scene)
    choose_display(scene, count, software=is_software())


def open_project(scene: bpy.types.Scene, project: Path, *, with_cameras: bool = True) -> SplatScene:
    """Import a project folder into `scene`: splats, cameras and objects. What it shows of the project is updated.

    Parameters
    ----------
    with_cameras : bool
        Add the cameras of the photos. The first becomes the scene camera if there is none.

    Returns
    -------
    SplatScene
        The whole scene. In a new Blender file, blending is set to ``"TRAINED"`` and the render is set up.

    Raises
    ------
    HeritageError
        When the project has no finished scene, or one of its files cannot be read.
    """
    project = project.absolute()
    file = scene_file(project)
    objects = shown_objects(project)
    camera_folder = path_within(project, "cameras")
    has_cameras = (camera_folder / "cameras.json").exists()
    camera_set = read_camera_set(camera_folder) if with_cameras and has_cameras else None
    measurement = load_measurement(project) if has_cameras else Measurement()
    earlier = whole_scene(scene, project)
    placement = None if earlier is None else world_matrix(earlier)
    frame = frame_of_whole(earlier) if SplatScene.is_splats(earlier) else None
    measured = {} if earlier is None else placement_properties(earlier)
    if earlier is not None:
        # The scene may have been trained again. Its placement is the user's choice.
        bpy.data.objects.remove(earlier)
        _remove_cameras(scene, camera_set)
    untouched = is_untouched(scene)
    if untouched and not heritage_objects(scene):
        # With splats in the scene, the setting is the user's choice. With other objects, splats blend as these do.
        scene.heritage.blending = "TRAINED"
    name = scene_name(project)
    splats = add_splat_file(scene, file, name, frame)
    splats.object.heritage.project = str(project)
    if placement is not None:
        set_world_matrix(splats.object, placement)
        for key, value in measured.items():
            splats.object[key] = value
    scene.heritage.project = str(project)
    if camera_set is not None:
        health = camera_set.health
        scene.heritage.camera_colour = "" if health is None else health.colour
        scene.heritage.camera_health = "" if health is None else health.sentence
        collection = new_collection(scene.collection, f"{name} Cameras")
        add_cameras(camera_set.cameras, collection)
        if scene.camera is None and camera_set.cameras:
            look_through(scene, "", INITIAL_RENDER_SIDE)
    if untouched:
        set_up_render(scene)
    # What was changed by hand and is not stored yet stays as it is in this file.
    kept = {obj.heritage.object_id for obj in heritage_objects(scene, "OBJECT") if obj.heritage.is_edited}
    kept.update(scene.heritage.deleted.split("\n"))
    added = add_objects(scene, project, [item.id for item in objects if item.id not in kept])
    if added and active_object(scene) is None:
        set_active_object(scene, added[0].object)
    apply_measurement(scene, project, measurement)
    return splats


def _remove_cameras(scene: bpy.types.Scene, camera_set: CameraSet | None) -> None:
    """Remove the cameras of the photos that are added again, and their collections where these are empty then."""
    names = {camera.photo for camera in camera_set.cameras} if camera_set is not None else set()
    for camera in [obj for obj in scene.objects if photo_of(obj) in names]:
        collections = list(camera.users_collection)
        bpy.data.objects.remove(camera)
        for collection in collections:
            if collection in bpy.data.collections.values() and not collection.all_objects:
                bpy.data.collections.remove(collection)


def scene_name(project: Path) -> str:
    """Return the name of a project's photo folder, or of a folder around it where that is generic."""
    name = scene_title(ProjectFolder.open_existing(project))
    return name.removesuffix("_heritage") or name


def add_objects(scene: bpy.types.Scene, project: Path, ids: Iterable[str]) -> list[SplatScene]:
    """Add or update the objects `ids` of the project. Each has a collection with its own splats.

    Returns
    -------
    list of SplatScene
        Sorted by name. An updated object keeps its name, collection, placement, threshold and record. A background that
        is added beside other objects is hidden, because it surrounds them.

    Raises
    ------
    HeritageError
        When a file of the project cannot be read, or an object to update is in Edit Mode.

    Notes
    -----
    Each object gets a copy of all Gaussians of the scene that any of its levels needs, and stands on its origin. The
    sliders then only change which of them are drawn and exported. Gaussians that the engine has given detail, those of
    the object at its stored level and threshold, are imported with it, except where they were moved by hand.
    All others are copied from the scene with its edits.
    """
    present = _shown_objects(scene, project)
    id_set = set(ids)
    items = [item for item in shown_objects(project) if item.id in id_set]
    if not items:
        return []
    whole = whole_scene(scene, project)
    if whole is None:
        whole = add_splat_file(scene, scene_file(project), scene_name(project)).object
        whole.heritage.project = str(project)
    splats = [
        update_object(present[item.id], project, item, whole)
        if item.id in present
        else add_object(scene, project, item, whole)
        for item in items
    ]
    for one in splats:
        add_known(project, one.object)
    mark_copies()
    if any(obj.heritage.kind != "background" for obj in heritage_objects(scene, "OBJECT")):
        for one in splats:
            obj = one.object
            if obj.heritage.kind == "background" and obj.heritage.object_id not in present:
                obj.heritage.hidden = True
    apply_blending(scene)
    apply_visibility(scene)
    apply_display(scene)
    return splats


def _shown_objects(scene: bpy.types.Scene, project: Path) -> dict[str, bpy.types.Object]:
    """Return what shows the objects of a project in `scene` by id, rather the object itself than a copy of it."""
    own = {obj.name for obj in owners().values()}
    shown = [obj for obj in heritage_objects(scene, "OBJECT") if obj.library is None and _belongs_to(obj, project)]
    return {obj.heritage.object_id: obj for obj in sorted(shown, key=lambda obj: obj.name in own)}


def whole_scene(scene: bpy.types.Scene, project: Path) -> bpy.types.Object | None:
    """Return the splats of the whole scene of `project`; None when they were deleted or not imported."""
    return next((obj for obj in heritage_objects(scene, "SCENE") if _belongs_to(obj, project)), None)


def _belongs_to(obj: bpy.types.Object, project: Path) -> bool:
    return bool(obj.heritage.project) and project_of(obj.heritage) == project
