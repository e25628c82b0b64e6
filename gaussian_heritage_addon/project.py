"""Reads a project folder for Blender: scene, objects, memberships and cameras. Does not import bpy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engine.errors import CameraError, FormatError, ProjectError
from ..engine.files import object_file
from ..engine.scene import Camera, read_camera_set

__all__ = [
    "ProjectObject",
    "default_project_folder",
    "list_objects",
    "load_level",
    "load_membership",
    "photo_camera",
    "scene_file",
]


@dataclass(frozen=True)
class ProjectObject:
    """The part of ``object.json`` that Blender shows.

    Attributes
    ----------
    id, name : str
        Folder name, and the user's name for the object.
    prompt : str
        Text of the prompt, or a description of it.
    score, threshold : float
        Confidence, and the smallest membership of a Gaussian that belongs to the object.
    kind : str
        Kind of prompt: ``"text"``, ``"click"``, ``"all"``, ``"background"``...
    level, n_levels : int
        Level that ``membership.npy`` contains (0 is the smallest part), and number of nested levels, at least 1.
    """

    id: str
    name: str
    prompt: str
    score: float
    threshold: float
    kind: str = ""
    level: int = 0
    n_levels: int = 1


def default_project_folder(photos: Path) -> Path:
    """Return the default project folder, next to the photo folder: ``<name>_heritage``."""
    return photos.with_name(f"{photos.name}_heritage")


def scene_file(project: Path) -> Path:
    """Return the file of the project's scene.

    Raises
    ------
    ProjectError
        When `project` contains no finished scene.
    """
    file = project / "gaussians" / "scene.ply"
    if not file.is_file():
        raise ProjectError(
            f"{project} contains no finished scene (gaussians/scene.ply is missing). Import its photo folder first."
        )
    return file


def list_objects(project: Path) -> list[ProjectObject]:
    """Return the objects of the project, sorted by name.

    Raises
    ------
    FormatError
        When an ``object.json`` cannot be read.
    """
    folders = sorted(file.parent.name for file in (project / "objects").glob("*/object.json"))
    objects = [_read_object(object_file(project, name, "object.json")) for name in folders]
    return sorted(objects, key=lambda item: (item.name.casefold(), item.id))


def _read_object(file: Path) -> ProjectObject:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        prompt = data.get("prompt", "")
        return ProjectObject(
            id=file.parent.name,
            name=str(data["name"]),
            prompt=_prompt_text(prompt),
            score=float(data.get("score", 0.0)),
            threshold=float(data["threshold"]),
            kind=str(prompt.get("kind", "")) if isinstance(prompt, dict) else "",
            level=int(data.get("level") or 0),
            n_levels=max(1, len(data.get("levels") or ())),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(
            f"{file} cannot be read: {error!r}. Delete its folder and isolate the object again."
        ) from error


def _prompt_text(prompt: Any) -> str:
    if not isinstance(prompt, dict):
        return str(prompt)
    if prompt.get("text"):
        return str(prompt["text"])
    match prompt.get("kind"):
        case "all":
            return "found without a prompt"
        case "background":
            return "what belongs to no object"
        case "click" if prompt.get("clicks"):
            return f"{len(prompt['clicks'])} clicks, {len(prompt.get('not') or ())} beside it"
    return ", ".join(f"{key} {value}" for key, value in prompt.items() if value is not None)


def load_membership(project: Path, object_id: str, count: int) -> NDArray[np.float32]:
    """Return the membership of the scene's `count` Gaussians in an object, shape [count], float32, in [0, 1].

    Raises
    ------
    FormatError
        When the file cannot be read, or belongs to another scene.
    """
    membership = _load(project, object_id, "membership.npy")
    _require_count(project, object_id, membership.shape, count)
    return np.array(membership, np.float32)


def load_level(project: Path, object_id: str, level: int, count: int) -> NDArray[np.float32]:
    """Return the membership in an object at one of its levels, shape [count], float32, without reading other levels.

    Raises
    ------
    FormatError
        When the file cannot be read, belongs to another scene, or has no such level.
    """
    levels = _load(project, object_id, "levels.npy")
    _require_count(project, object_id, levels.shape[1:], count)
    if not 0 <= level < len(levels):
        raise FormatError(
            f"The object {object_id} of {project} has only {len(levels)} levels now; level {level + 1} is missing. "
            "Open the project again."
        )
    return np.array(levels[level], np.float32)


def _load(project: Path, object_id: str, name: str) -> NDArray[np.floating[Any]]:
    file = object_file(project, object_id, name)
    try:
        # Memory-mapped: the slider needs only one of several levels.
        return np.load(file, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError) as error:
        raise FormatError(f"{file} cannot be read: {error}. Isolate the object again.") from error


def _require_count(project: Path, object_id: str, shape: tuple[int, ...], count: int) -> None:
    if shape != (count,):
        raise FormatError(
            f"The object {object_id} of {project} belongs to another version of the scene "
            f"({'x'.join(map(str, shape))} Gaussians, not {count}). Isolate it again."
        )


def photo_camera(project: Path, photo: str) -> Camera:
    """Return the camera of a photo, with its lens distortion.

    Raises
    ------
    FormatError
        When the project's cameras cannot be read.
    CameraError
        When the photo has no camera.
    """
    for camera in read_camera_set(project / "cameras").cameras:
        if camera.photo == photo:
            return camera
    raise CameraError(f"{project} has no camera of the photo {photo!r}. Open the project again.")
