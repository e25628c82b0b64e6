"""What came nearest to texts that were not found: ``objects/candidates.json`` of a project. No bpy."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..engine.errors import DiskError, FormatError

__all__ = ["Candidate", "NotFound", "dismiss", "read_not_found"]


@dataclass(frozen=True)
class Candidate:
    """Something that may be what was meant.

    Attributes
    ----------
    number : int
        For ``segment --accept``.
    text : str
        What was asked for.
    score : float
        Confidence, 0 to 1.
    photo : str
        Where the picture was cut out.
    picture : Path
        A file that need not be there.
    """

    number: int
    text: str
    score: float
    photo: str
    picture: Path


@dataclass(frozen=True)
class NotFound:
    """Of the last search by text.

    Attributes
    ----------
    messages : tuple of str
        A sentence for each text that was refused.
    candidates : tuple of Candidate
        Best first for each text.
    """

    messages: tuple[str, ...]
    candidates: tuple[Candidate, ...]


def _file(project: Path) -> Path:
    return project / "objects" / "candidates.json"


def read_not_found(project: Path) -> NotFound | None:
    """Return what the last search by text did not find; None when it found all, or was taken off the screen.

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


# A panel asks at each redraw.
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
        raise FormatError(f"{file} cannot be read: {error!r}. Delete it and ask again.") from error


def _candidate(project: Path, entry: dict[str, Any]) -> Candidate:
    return Candidate(
        number=int(entry["number"]),
        text=str(entry["text"]),
        score=float(entry["score"]),
        photo=str(entry["photo"]),
        picture=project / str(entry["picture"]),
    )


def dismiss(project: Path) -> None:
    """Take the list off the screen.

    Raises
    ------
    DiskError
        When its file cannot be removed.
    """
    try:
        _file(project).unlink(missing_ok=True)
    except OSError as error:
        raise DiskError(f"Could not remove {_file(project)}: {error.strerror or error}. Check permissions.") from error
