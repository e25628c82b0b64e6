"""The contents of a finished project, as Blender and the server show it: scene, objects and cameras.

Standard library and NumPy only.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import CameraError, FormatError, ObjectError, ProjectError
from ..core.files import object_file, path_within
from ..scene import Camera, read_camera_set
from .folder import PROJECT_FILE, ProjectFolder
from .objects import RECORD_FILE, ObjectRecord, list_objects

_ADVICE = "Isolate the object again."
_MAX_TEXT = 1000
"""Characters of a text from a project that are kept in the .blend file."""


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
    n_gaussians : int
        Gaussians that belong to it.
    has_detail : bool
        Whether it was trained further on the photos, with success.
    """

    id: str
    name: str
    prompt: str
    score: float
    threshold: float
    kind: str = ""
    level: int = 0
    n_levels: int = 1
    n_gaussians: int = 0
    has_detail: bool = False


def default_project_folder(photos: Path) -> Path:
    """Return the default project folder, next to the photo folder or video: ``<name>_heritage``."""
    return photos.with_name(f"{photos.stem if photos.is_file() else photos.name}_heritage")


def scene_file(project: Path) -> Path:
    """Return the file of the project's scene.

    Raises
    ------
    ProjectError
        When `project` contains no finished scene, or is no project.
    FormatError
        When its ``project.json`` is damaged or of a format number that is not known.
    """
    file = path_within(project, "gaussians", "scene.ply")
    if not file.is_file():
        raise ProjectError(
            f"{project} contains no finished scene (gaussians/scene.ply is missing). Import its photo folder first."
        )
    ProjectFolder.open_existing(project)
    return file


def report_file(project: Path, language: str = "en") -> Path:
    """Return the file of the project's report in a language, by its code, which need not exist."""
    return path_within(project, "report", "report.html" if language == "en" else f"report_{language}.html")


def readable_report(project: Path, language: str) -> Path:
    """Return the report in a language, or in English where it was written before there was this language."""
    file = report_file(project, language)
    return file if file.is_file() else report_file(project)


def shown_objects(project: Path) -> list[ProjectObject]:
    """Return the objects of the project as a user sees them, sorted by name.

    Raises
    ------
    FormatError
        When an ``object.json`` cannot be read.
    """
    objects = [_shown(project, record) for record in list_objects(project)]
    return sorted(objects, key=lambda item: (item.name.casefold(), item.id))


def _shown(project: Path, record: ObjectRecord) -> ProjectObject:
    n_levels = max(1, len(record.levels))
    if not 0 <= record.level < n_levels:
        file = object_file(project, record.id, RECORD_FILE)
        raise FormatError(f"{file} cannot be read: it has {n_levels} levels, not level {record.level}. {_ADVICE}")
    return ProjectObject(
        id=record.id,
        name=record.name[:_MAX_TEXT],
        prompt=_prompt_text(record.prompt)[:_MAX_TEXT],
        score=min(max(record.score, 0.0), 1.0),
        threshold=record.threshold,
        kind=str(record.prompt.get("kind", ""))[:_MAX_TEXT],
        level=record.level,
        n_levels=n_levels,
        n_gaussians=record.n_gaussians,
        has_detail=bool((record.detail or {}).get("kept")),
    )


def _prompt_text(prompt: dict[str, Any]) -> str:
    if prompt.get("text"):
        return str(prompt["text"])
    clicks, others = ((value if isinstance(value, list) else []) for value in map(prompt.get, ("clicks", "not")))
    place = f"in {prompt.get('photo')}"
    match prompt.get("kind"):
        case "all":
            return "found without a prompt"
        case "background":
            return "what belongs to no object"
        case "hand":
            return "made by hand"
        case "click" if clicks:
            return f"{len(clicks)} clicks, {len(others)} beside it"
        case "click":
            return f"a click {place}, {len(others)} beside it" if others else f"a click {place}"
        case "box" | "mask" as kind:
            return f"a {kind} {place}"
    return ", ".join(f"{key} {value}" for key, value in prompt.items() if value is not None)


def is_project(folder: Path) -> bool:
    """Return whether `folder` is a project. A .blend file may name any folder."""
    return os.path.isfile(folder / PROJECT_FILE)


def require_object(project: Path, object_id: str) -> None:
    """Raise `ObjectError` unless `project` is a project with the object `object_id`, and `FormatError` for no id."""
    # Unlike Path.is_file, this is false for names that are too long.
    if not (is_project(project) and os.path.isfile(object_file(project, object_id, RECORD_FILE))):
        raise ObjectError(f"{project} has no object {object_id!r}. Changes are kept in this .blend file only.")


def photo_camera(project: Path, photo: str) -> Camera:
    """Return the camera of a photo, with its lens distortion.

    Raises
    ------
    FormatError
        When the project's cameras cannot be read.
    CameraError
        When the photo has no camera.
    """
    camera = read_camera_set(path_within(project, "cameras")).by_photo.get(photo)
    if camera is None:
        raise CameraError(f"{project} has no camera of the photo {photo!r}. Open the project again.")
    return camera
