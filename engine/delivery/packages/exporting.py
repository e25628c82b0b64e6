"""The Gaussians of a scene or an object as they are exported, with their record, in each format.

What renders is imported where it is needed: PyTorch takes seconds to start, which most exports would only wait for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import ObjectError, SettingsError
from ...core.events import StopCheck
from ...formats import FileFacts, Up, WritingTools, format_of, write_mesh, write_scene
from ...pictures import encode_picture, encode_png
from ...project.folder import ProjectFolder
from ...project.objects import list_objects, load_membership, load_object, object_gaussians
from ...scene import (
    Camera,
    CameraSet,
    ExportFrame,
    Gaussians,
    Measurement,
    PinholeCamera,
    bottom_middle,
    box_of,
    export_frame,
    far_gaussians,
    focal_and_center,
    load_measurement,
    read_camera_set,
)
from ...training import load_gaussians
from ..records import describe_object, describe_scene, ply_comments, record_summary, xmp_packet
from .page import Framing, Part, framing_of_object, framing_of_scene, write_page

if TYPE_CHECKING:
    from ...meshing import MeshResult
    from ...meshing.settings import MeshSettings
    from ...rasterizer.settings import Backend
    from .turntable import Turn

_UP: dict[str, Up | None] = {"original": None, "world": "z"}
"""The axis that points up where neither the format nor its viewers say it; given poses do not say what is up."""
_COVERAGE_SIDE = 160
"""Longest side of the pictures in which is counted which photos saw a Gaussian."""
_N_VIEWS = 8
_VIEW_SIDE = 512


@dataclass(frozen=True)
class Export:
    """The Gaussians that are exported, with all that is known of them.

    Attributes
    ----------
    gaussians : Gaussians
        In the upright frame.
    described : dict
        The record.
    camera_set : CameraSet
    members : bool array of shape [N] or None
        The object's Gaussians in the scene; None for the scene.
    whole : Gaussians
        The scene.
    measurement : Measurement
        Of the project.
    notes : dict
        What was left out of the Gaussians, for the file.
    parts : callable
        Reads the objects of a scene, with the members among all its Gaussians; only a page needs them.
    """

    gaussians: Gaussians
    described: dict[str, Any]
    camera_set: CameraSet
    members: NDArray[np.bool_] | None
    whole: Gaussians
    measurement: Measurement
    notes: dict[str, Any] = field(default_factory=dict)
    parts: Callable[[], tuple[Part, ...]] = tuple


def load_export(project: ProjectFolder, name: str | None, *, title: str | None = None) -> Export:
    """Return the scene (None) or the object called `name`, by name or id.

    `title` is that of the scene; by default its photos' folder names it.

    Raises
    ------
    HeritageError
        When there is no such object, or a part of the project is missing or damaged.
    """
    project.require_intact("cameras", "training")
    whole = load_gaussians(project.path / "gaussians")
    camera_set = read_camera_set(project.path / "cameras")
    measurement = load_measurement(project.path)
    if name is None:
        described = describe_scene(project, title=title)
        return Export(
            whole, described, camera_set, None, whole, measurement, parts=partial(_objects, project, len(whole))
        )
    record = load_object(project.path, name)
    gaussians = object_gaussians(project.path, record, whole)
    members = load_membership(project.path, record.id) >= record.threshold
    described = describe_object(project, record.id, title=title) | _size(gaussians, measurement)
    return Export(gaussians, described, camera_set, members, whole, measurement)


def _objects(project: ProjectFolder, count: int) -> tuple[Part, ...]:
    """Return the objects of a scene of `count` Gaussians; those of an earlier training are none of its parts."""
    records = sorted(list_objects(project.path), key=lambda one: (one.name.casefold(), one.id))
    current = [one for one in records if one.n_scene_gaussians == count]
    return tuple(Part(one.id, one.name, load_membership(project.path, one.id) >= one.threshold) for one in current)


def divided(export: Export) -> tuple[Export, Export | None]:
    """Return a scene without its far Gaussians (`engine.scene.far_gaussians`), and those alone; None without any.

    An object stays as it is: nothing of it is far.
    """
    if export.members is not None:
        return export, None
    far = far_gaussians(export.gaussians, export.camera_set)
    if not far.any() or far.all():
        return export, None
    n_far = int(far.sum())
    near = replace(export, gaussians=export.gaussians[~far], notes={**export.notes, "far_left_out": n_far})
    return near, replace(export, gaussians=export.gaussians[far], notes={**export.notes, "far_only": n_far})


def write_export(
    path: Path,
    export: Export,
    file_format: str,
    *,
    frame: ExportFrame | str | None,
    with_record: bool = True,
    in_scene: bool = False,
    backend: Backend = "cpu",
) -> ExportFrame:
    """Write a file of one of `engine.formats.FORMATS` atomically, and return its frame.

    Parameters
    ----------
    frame : ExportFrame or {"upright", "original", "world"}, optional
        Frame of the coordinates, see `engine.scene.export_frame`; ``world``: the normalised world, Z up in PLY.
        That of an `ExportFrame`, which another program chose, is not moved.
    with_record : bool
        Whether the file carries the record, and how many photos saw each Gaussian, where its format has a place for
        them. A page always has the record.
    in_scene : bool
        Whether an object stays where it stands in the scene. Otherwise the middle of its bottom is the origin, but not
        in the frames ``original`` and ``world``.
    backend : {"cpu", "gpu", "reference"}
        Rasterizer with which the sides are found from which a page shows an object, and what photos saw.

    Raises
    ------
    SettingsError
        For a page without its record or in another frame.
    HeritageError
        When the file cannot be written.
    """
    described, gaussians, kind = export.described, export.gaussians, format_of(file_format)
    placed = _placed(export, frame)
    if kind.is_page:
        if frame not in (None, "upright"):
            raise SettingsError("A page shows what is upright. Leave out --frame.")
        if not with_record:
            raise SettingsError("A page shows the record. Leave out --record none.")
        write_page(path, gaussians, described, _framing(export, backend), _parts(export))
        return placed
    matrix, notes = _own_origin(export, placed, in_scene=in_scene)
    seen = _photos_that_saw(export, backend) if with_record and len(gaussians) and kind.carries_seen else None
    if seen is not None:
        notes["seen_by_no_photo"] = int((seen == 0).sum())
    facts = _facts(export, placed, matrix, notes, with_record=with_record and kind.carries_record)
    facts = replace(facts, seen=seen)
    write_scene(path, gaussians, file_format, facts, WritingTools(encode_picture))
    return placed


def mesh_of(
    project: ProjectFolder,
    export: Export,
    settings: MeshSettings,
    *,
    backend: Backend = "cpu",
    should_stop: StopCheck,
    tell: Callable[[float], None] = lambda done: None,
) -> MeshResult:
    """Return the mesh of an exported object, in the normalised world.

    Parameters
    ----------
    export : Export
        Of an object.
    backend : {"cpu", "gpu", "reference"}
    should_stop, tell : callable
        See `engine.meshing.mesh_object`.

    Raises
    ------
    ObjectError
        When it is not an object, or has no surface.
    HeritageError
        When a photo cannot be read, or the user stops.
    """
    from ...meshing import mesh_object
    from ...objects import DetailPhotos
    from ...pictures import Scene

    if export.members is None:
        raise ObjectError("A mesh is made of one object. Name one with --object, or export the Gaussians of the scene.")
    whole = replace(export.whole, features=None)
    own = replace(export.gaussians, features=None)
    scene = own.joined(whole[np.flatnonzero(~export.members)])
    return mesh_object(
        Scene(scene, backend=backend), np.arange(len(scene)) < len(own), export.camera_set.cameras,
        DetailPhotos.of(project), settings, should_stop=should_stop, tell=tell,
    )  # fmt: skip


def write_mesh_export(
    path: Path,
    export: Export,
    made: MeshResult,
    file_format: str,
    *,
    frame: ExportFrame | str | None,
    with_record: bool = True,
    in_scene: bool = False,
) -> ExportFrame:
    """Write a mesh in one of the formats of meshes, with the record and in the place of the object's Gaussians.

    Parameters
    ----------
    frame, with_record, in_scene
        As of `write_export`.

    Raises
    ------
    HeritageError
        When the file cannot be written.
    """
    kind, placed = format_of(file_format), _placed(export, frame)
    matrix, notes = _own_origin(export, placed, in_scene=in_scene)
    facts = _facts(
        export,
        placed,
        matrix,
        {**notes, "mesh": mesh_sentence(made, placed)},
        with_record=with_record and kind.carries_record,
    )
    texture = made.mesh.texture if kind.ignores_alpha else made.mesh.texture[..., :3]
    write_mesh(path, made.mesh, file_format, facts, encode_png(texture) if kind.shows_texture else b"")
    return placed


def mesh_sentence(made: MeshResult, placed: ExportFrame) -> str:
    """Return what a record and a user are told of a mesh."""
    record = made.record
    text = f"{record['triangles']} triangles, fused from {record['photos']} photos"
    share = 100 * record["filled_share"]
    if record["filled"]:
        text += f"; {share:.1f} % of the surface was seen by no photo and was filled in"
    else:
        text += "; all of it was seen by photos, and the rest is open" if not record["watertight"] else ""
    if record["volume"] is not None:
        if placed.metres_per_unit is not None:
            growth = abs(float(np.linalg.det(placed.from_world[:3, :3])))
            cubic = record["volume"] * growth * (placed.metres_per_unit * 100) ** 3
            text += f"; watertight, {cubic:.4g} cm3"
        else:
            text += "; watertight, of unknown unit"
    return text + "; base colour from the photos with their light, roughness not measured"


def _own_origin(export: Export, placed: ExportFrame, *, in_scene: bool) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Return the transform from the normalised world to the file, Z up, and the notes of the export with the origin."""
    is_moved = placed.name not in ("original", "world", "placed")
    matrix, notes, gaussians = placed.from_world, dict(export.notes), export.gaussians
    if export.members is not None and len(gaussians) and is_moved and not in_scene:
        origin = bottom_middle((gaussians.means @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32))
        matrix = _moved(-origin) @ matrix
        notes["origin_in_scene"] = " ".join(f"{value:.6g}" for value in origin)
    return matrix, notes


def _facts(
    export: Export, placed: ExportFrame, matrix: NDArray[np.float64], notes: dict[str, Any], *, with_record: bool
) -> FileFacts:
    """Return what a file says beside its Gaussians or its mesh."""
    described = export.described
    facts = FileFacts(matrix=matrix, up=_UP.get(placed.name, "-y"), metres_per_unit=placed.metres_per_unit)
    if not with_record:
        return facts
    extras = {**record_summary(described, frame=placed.name), **_unit_facts(placed, described), **notes}
    return replace(
        facts,
        name=described["title"],
        extras=extras,
        comments=ply_comments(extras),
        rights=(described.get("object") or {}).get("rights"),
        xmp=xmp_packet(described),
    )


def _placed(export: Export, frame: ExportFrame | str | None) -> ExportFrame:
    if isinstance(frame, ExportFrame):
        return frame
    if frame == "world":
        return ExportFrame("world", np.eye(4), export.measurement.metres_per_unit)
    return export_frame(export.camera_set, export.measurement, frame)


def _unit_facts(placed: ExportFrame, described: dict[str, Any]) -> dict[str, Any]:
    """Return the frame and the unit of a file; an unknown unit is said in a sentence."""
    facts = {key: value for key, value in placed.as_dict().items() if value is not None}
    return facts if placed.metres_per_unit is not None else {**facts, "unit": f"unknown. {described['unit']['text']}"}


def _moved(by: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


def _photos_that_saw(export: Export, backend: Backend) -> NDArray[np.int32]:
    """Return how many photos saw each exported Gaussian: its centre is in the picture, and nothing is before it."""
    from ...cameras import training_pinhole
    from ...training import Coverage, Parameters

    whole = export.whole
    values = Parameters.from_gaussians(whole, sh_degree=whole.sh_degree, features=False).values
    cameras = [training_pinhole(camera, max_side=_COVERAGE_SIDE) for camera in export.camera_set.cameras]
    return Coverage(values, cameras, backend=backend).of_places(export.gaussians.means)


def _parts(export: Export) -> list[Part]:
    """Return the objects of an exported scene; what is left out of it lies before what is kept."""
    first = len(export.whole) - len(export.gaussians)
    return [Part(one.id, one.name, one.members[first:]) for one in export.parts()]


def _framing(export: Export, backend: Backend) -> Framing:
    cameras = export.camera_set.cameras
    vertical = export_frame(export.camera_set, export.measurement, "upright").from_world[2, :3]
    up = (vertical / np.linalg.norm(vertical)).tolist()
    if export.members is None:
        return framing_of_scene([_pinhole(camera) for camera in cameras], up)
    if len(export.gaussians) == 0:
        return Framing([0.0, 0.0, 0.0], 1.0, (), up)
    from ...pictures import Scene
    from ..report import best_seen_from, orbit_cameras

    (seen_from,) = best_seen_from(Scene(export.whole, backend=backend), [export.members], cameras)
    sides = orbit_cameras(export.gaussians.means, seen_from, count=_N_VIEWS, side=_VIEW_SIDE)
    return framing_of_object(export.gaussians, sides, up)


def _size(gaussians: Gaussians, measurement: Measurement) -> dict[str, Any]:
    """Return the size of an object in metres, as a part of its record; empty where the unit is not known."""
    if measurement.metres_per_unit is None or len(gaussians) == 0:
        return {}
    matrix = measurement.measured_from_world
    low, high = box_of((gaussians.means @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32))
    width, depth, height = (float(value) for value in high - low)
    size = {"width_metres": width, "depth_metres": depth, "height_metres": height}
    text = f"{100 * width:.1f} x {100 * depth:.1f} x {100 * height:.1f} cm (width, depth, height of its Gaussians)"
    return {"size": {**size, "text": text}}


def _pinhole(camera: Camera) -> PinholeCamera:
    """Return the camera without its lens distortion, which no viewer draws."""
    fx, fy, cx, cy = focal_and_center(camera)
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return PinholeCamera(np.asarray(camera.viewmat), K, camera.width, camera.height)


def turn_of(export: Export, backend: Backend, should_stop: StopCheck) -> Turn:
    """Return pictures of what is exported from all sides: around an object, or from the photos' places in a scene.

    Parameters
    ----------
    export : Export
        With at least one Gaussian.
    backend : {"cpu", "gpu", "reference"}
    should_stop : callable
        See `engine.core.events`.
    """
    from .turntable import turn_of_object, turn_of_scene

    cameras = export.camera_set.cameras
    if export.members is None:
        return turn_of_scene(export.gaussians, cameras, backend=backend, should_stop=should_stop)
    return turn_of_object(
        export.whole, export.members, export.gaussians, cameras, backend=backend, should_stop=should_stop
    )
