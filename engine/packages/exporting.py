"""The Gaussians of a scene or an object as they are exported, with their record, in each format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError
from ..events import StopCheck
from ..formats import transform_gaussians, write_glb, write_ply
from ..gaussians import load_gaussians
from ..objects import load_membership, load_object, object_gaussians
from ..pictures import Backend, Scene
from ..project_folder import ProjectFolder
from ..records import describe_object, describe_scene, gltf_extras, ply_comments, xmp_packet
from ..report import best_seen_from, orbit_cameras
from ..scene import Camera, CameraSet, Gaussians, PinholeCamera, focal_and_center, read_camera_set
from .page import Framing, framing_of_object, framing_of_scene, write_page
from .turntable import Turn, turn_of_object, turn_of_scene

__all__ = ["FORMATS", "Export", "load_export", "turn_of", "write_export"]

FORMATS = ("ply", "glb", "html")
_N_VIEWS = 8  # by definition
_VIEW_SIDE = 512  # by definition


@dataclass(frozen=True)
class Export:
    """What is exported.

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
    notes : dict
        What was left out of the Gaussians, for the file.
    """

    gaussians: Gaussians
    described: dict[str, Any]
    camera_set: CameraSet
    members: NDArray[np.bool_] | None
    whole: Gaussians
    notes: dict[str, Any] = field(default_factory=dict)


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
    if name is None:
        return Export(whole, describe_scene(project, title=title), camera_set, None, whole)
    record = load_object(project.path, name)
    gaussians = object_gaussians(project.path, record, whole)
    members = load_membership(project.path, record.id) >= record.threshold
    return Export(gaussians, describe_object(project, record.id, title=title), camera_set, members, whole)


def write_export(
    path: Path, export: Export, file_format: str, *, frame: str, with_record: bool = True, backend: Backend = "cpu"
) -> None:
    """Write a file of one of `FORMATS` atomically.

    Parameters
    ----------
    path : Path
    export : Export
    file_format : str
    frame : {"upright", "original"}
        Frame of the coordinates, see `CameraSet.original_from_world`.
    with_record : bool
        Whether the file carries the record: comments of PLY, ``asset.extras`` and XMP of glTF. A page always does.
    backend : {"cpu", "gpu", "reference"}
        Rasterizer with which the sides are found from which a page shows an object.

    Raises
    ------
    SettingsError
        For a page without its record or in another frame.
    HeritageError
        When the file cannot be written.
    """
    described, gaussians = export.described, export.gaussians
    if file_format == "html":
        if frame != "upright":
            raise SettingsError("A page shows what is upright. Leave out --frame original.")
        if not with_record:
            raise SettingsError("A page shows the record. Leave out --record none.")
        write_page(path, gaussians, described, _framing(export, backend))
        return
    if frame == "original":
        gaussians = transform_gaussians(gaussians, export.camera_set.original_from_world)
    if file_format == "ply":
        notes = [f"{name} {value}" for name, value in export.notes.items()]
        write_ply(path, gaussians, comments=[*ply_comments(described, frame=frame), *notes] if with_record else ())
        return
    write_glb(
        path,
        gaussians,
        name=described["title"] if with_record else "Gaussians",
        copyright=(described.get("object") or {}).get("rights") if with_record else None,
        extras={**gltf_extras(described, frame=frame), **export.notes} if with_record else None,
        xmp=xmp_packet(described) if with_record else None,
    )


def _framing(export: Export, backend: Backend) -> Framing:
    cameras = export.camera_set.cameras
    if export.members is None:
        return framing_of_scene([_pinhole(camera) for camera in cameras])
    if len(export.gaussians) == 0:
        return Framing([0.0, 0.0, 0.0], 1.0, ())
    (seen_from,) = best_seen_from(Scene(export.whole, backend=backend), [export.members], cameras)
    return framing_of_object(export.gaussians, _sides(export.gaussians, seen_from))


def _sides(gaussians: Gaussians, seen_from: Sequence[Camera]) -> list[PinholeCamera]:
    return orbit_cameras(gaussians.means, seen_from, count=_N_VIEWS, side=_VIEW_SIDE)


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
        See `engine.events`.
    """
    cameras = export.camera_set.cameras
    if export.members is None:
        return turn_of_scene(export.gaussians, cameras, backend=backend, should_stop=should_stop)
    return turn_of_object(
        export.whole, export.members, export.gaussians, cameras, backend=backend, should_stop=should_stop
    )
