"""Prompts that were not found, with their candidates: reads ``objects/candidates.json`` of a project.

Standard library only.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import FormatError, ProjectError
from .files import delete_derived, optional, path_within, read_json
from .project_content import is_project

__all__ = ["Candidate", "NotFound", "dismiss", "read_not_found"]

_FILE = ("objects", "candidates.json")
_SCHEMA = {
    "refused": [{"message": str, "words": optional([str])}],
    "candidates": optional([{"number": int, "text": str, "score": float, "photo": str, "picture": str}]),
}
_MAX_SHOWN = 50
"""Prompts and candidates that a panel can show."""
_MAX_WORDS = 5
"""Words of a prompt that can be shown."""
_MAX_TEXT = 1000
"""Characters of a text that are kept."""


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
    words : tuple of str
        May be asked for in place of the prompts that are not known.
    """

    messages: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    words: tuple[str, ...] = ()


def read_not_found(project: Path) -> NotFound | None:
    """Return the prompts that the last search by text did not find; None when all were found or the list was closed.

    Raises
    ------
    FormatError
        When the file cannot be read.
    """
    try:
        file = path_within(project, *_FILE)
        changed = file.stat().st_mtime_ns
    except (OSError, ValueError):  # ValueError: a null character in the path
        return None
    found = _read(project, file, changed)
    if isinstance(found, FormatError):
        raise found.with_traceback(None)
    return found


# Cached, because the panel calls this at each redraw; an error too.
@functools.lru_cache(maxsize=4)
def _read(project: Path, file: Path, changed: int) -> NotFound | FormatError:
    try:
        data = read_json(file, _SCHEMA, advice="Delete it and search again.")
        return NotFound(
            messages=tuple(refused["message"][:_MAX_TEXT] for refused in data["refused"][:_MAX_SHOWN]),
            candidates=tuple(_candidate(project, entry) for entry in data.get("candidates", ())[:_MAX_SHOWN]),
            words=tuple(
                word[:_MAX_TEXT]
                for refused in data["refused"][:_MAX_SHOWN]
                for word in (refused.get("words") or ())[:_MAX_WORDS]
            ),
        )
    except FormatError as error:
        return error


def _candidate(project: Path, entry: dict[str, Any]) -> Candidate:
    return Candidate(
        number=entry["number"],
        text=entry["text"][:_MAX_TEXT],
        score=float(entry["score"]),
        photo=entry["photo"][:_MAX_TEXT],
        picture=path_within(project, entry["picture"]),
    )


def dismiss(project: Path) -> None:
    """Close the list by deleting its file.

    Raises
    ------
    ProjectError
        When `project` is not a project.
    DiskError
        When the file cannot be deleted.
    """
    if not is_project(project):
        raise ProjectError(f"{project} is not a Gaussian Heritage project, so nothing is deleted there.")
    delete_derived(project, *_FILE)
