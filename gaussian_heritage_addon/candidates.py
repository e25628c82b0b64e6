"""Candidates for prompts that were not found: reads ``objects/candidates.json`` of a project. Does not import bpy."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..engine.errors import DiskError, FormatError
from ..engine.files import path_within

__all__ = ["Candidate", "NotFound", "dismiss", "read_not_found"]


@dataclass(frozen=True)
class Candidate:
    """A possible match for a prompt that was not found.

    Attributes
    ----------
    number : int
        Argument of ``segment --accept``.
    text : str
        The prompt.
    score : float
        Confidence, 0 to 1.
    photo : str
        Name of the photo that `picture` was cropped from.
    picture : Path
        Crop of the candidate. The file may be missing.
    """

    number: int
    text: str
    score: float
    photo: str
    picture: Path


@dataclass(frozen=True)
class NotFound:
    """Prompts of the last search by text that were not found.

    Attributes
    ----------
    messages : tuple of str
        One sentence for each prompt.
    candidates : tuple of Candidate
        Best first for each prompt.
    """

    messages: tuple[str, ...]
    candidates: tuple[Candidate, ...]


def _file(project: Path) -> Path:
    return path_within(project, "objects", "candidates.json")


def read_not_found(project: Path) -> NotFound | None:
    """Return the prompts that the last search by text did not find; None when all were found or the list was closed.

    Raises
    ------
    FormatError
        When the file cannot be read.
    """
    file = _file(project)
    try:
        changed = file.stat().st_mtime_ns
    except OSError:
        return None
    return _read(file, changed)


# Cached, because the panel calls this at each redraw.
@functools.lru_cache(maxsize=4)
def _read(file: Path, changed: int) -> NotFound:
    project = file.parent.parent
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        return NotFound(
            messages=tuple(str(refused["message"]) for refused in data["refused"]),
            candidates=tuple(_candidate(project, entry) for entry in data.get("candidates", ())),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{file} cannot be read: {error!r}. Delete it and search again.") from error


def _candidate(project: Path, entry: dict[str, Any]) -> Candidate:
    return Candidate(
        number=int(entry["number"]),
        text=str(entry["text"]),
        score=float(entry["score"]),
        photo=str(entry["photo"]),
        picture=path_within(project, str(entry["picture"])),
    )


def dismiss(project: Path) -> None:
    """Close the list by deleting its file.

    Raises
    ------
    DiskError
        When the file cannot be deleted.
    """
    try:
        _file(project).unlink(missing_ok=True)
    except OSError as error:
        raise DiskError(f"Could not remove {_file(project)}: {error.strerror or error}. Check permissions.") from error
