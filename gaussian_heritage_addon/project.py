"""What Blender reads of a project folder. No bpy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engine.errors import FormatError, ProjectError

__all__ = ["ProjectObject", "default_project_folder", "list_objects", "load_membership", "scene_file"]


@dataclass(frozen=True)
class ProjectObject:
    """The part of ``object.json`` that Blender shows.

    Attributes
    ----------
    id, name : str
        Folder name, and what the person called it.
    prompt : str
        What was asked for, in words.
    score, threshold : float
        Confidence, and the membership from which a Gaussian belongs to the object.
    """

    id: str
    name: str
    prompt: str
    score: float
    threshold: float


def default_project_folder(photos: Path) -> Path:
    """Return the project folder beside a photo folder: ``<name>_heritage``."""
    return photos.with_name(f"{photos.name}_heritage")


def scene_file(project: Path) -> Path:
    """Return the project's scene.

    Raises
    ------
    ProjectError
        When `project` holds no finished scene.
    """
    file = project / "gaussians" / "scene.ply"
    if not file.is_file():
        raise ProjectError(
            f"{project} holds no finished scene (no gaussians/scene.ply). Import its photo folder first."
        )
    return file


def list_objects(project: Path) -> list[ProjectObject]:
    """Return the project's objects by name.

    Raises
    ------
    FormatError
        When an ``object.json`` cannot be read.
    """
    found = [_read_object(file) for file in (project / "objects").glob("*/object.json")]
    return sorted(found, key=lambda item: (item.name.casefold(), item.id))


def _read_object(file: Path) -> ProjectObject:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        return ProjectObject(
            id=file.parent.name,
            name=str(data["name"]),
            prompt=_in_words(data.get("prompt", "")),
            score=float(data.get("score", 0.0)),
            threshold=float(data["threshold"]),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(
            f"{file} cannot be read: {error!r}. Delete its folder and isolate the object again."
        ) from error


def _in_words(prompt: Any) -> str:
    if not isinstance(prompt, dict):
        return str(prompt)
    return str(prompt.get("text") or ", ".join(f"{key} {value}" for key, value in prompt.items() if value is not None))


def load_membership(project: Path, object_id: str, count: int) -> NDArray[np.float32]:
    """Return the membership of the scene's `count` Gaussians in an object, shape [count], float32, in [0, 1].

    Raises
    ------
    FormatError
        When it cannot be read, or belongs to another scene.
    """
    file = project / "objects" / object_id / "membership.npy"
    try:
        membership: NDArray[np.float32] = np.load(file, allow_pickle=False).astype(np.float32)
    except (OSError, ValueError) as error:
        raise FormatError(f"{file} cannot be read: {error}. Isolate the object again.") from error
    if membership.shape != (count,):
        raise FormatError(
            f"{file} belongs to another state of the scene ({membership.size} Gaussians, not {count}). "
            "Isolate the object again."
        )
    return membership
