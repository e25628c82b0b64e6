"""Prompts that were not found, with their candidates: reads ``objects/candidates.json`` of a project.

Standard library only.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import ProjectError, PromptError
from ..core.files import delete_derived, optional, path_within, read_after_change, read_json, stamp_of
from .content import is_project

_FILE = ("objects", "candidates.json")
_SCHEMA = {
    "refused": [
        {
            "message": str,
            "text": str,
            "suggestions": optional([str]),
            "objects": optional([str]),
            "offer": optional(str),
        }
    ],
    "candidates": optional(
        [{"number": int, "text": str, "score": float, "photo": str, "picture": str, "object": optional((str, None))}]
    ),
}
_MAX_SHOWN = 50
"""Prompts and candidates that a panel can show."""
_MAX_SUGGESTIONS = 5
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
    object_id : str
        Id of the stored object that it is; empty for none.
    """

    number: int
    text: str
    score: float
    photo: str
    picture: Path
    object_id: str = ""


@dataclass(frozen=True)
class Refusal:
    """A prompt that was not found.

    Attributes
    ----------
    message : str
        Why, as a sentence.
    text : str
        The prompt.
    suggestions : tuple of str
        Prompts that may have been meant.
    object_ids : tuple of str
        Stored objects whose names are spelt nearly like it.
    offer : str
        Model that knows more words and can be fetched; empty for none.
    """

    message: str
    text: str = ""
    suggestions: tuple[str, ...] = ()
    object_ids: tuple[str, ...] = ()
    offer: str = ""


@dataclass(frozen=True)
class NotFound:
    """Prompts of the last search by text that were not found.

    Attributes
    ----------
    refusals : tuple of Refusal
    candidates : tuple of Candidate
        Best first for each prompt.
    """

    refusals: tuple[Refusal, ...]
    candidates: tuple[Candidate, ...]

    @property
    def offer(self) -> str:
        """Model that knows more words than that which refused; empty for none."""
        return next((one.offer for one in self.refusals if one.offer), "")


@read_after_change("/".join(_FILE))
def read_not_found(project: Path) -> NotFound | None:
    """Return the prompts that the last search by text did not find; None when all were found or the list was closed.

    Raises
    ------
    FormatError
        When the file cannot be read.
    """
    if stamp_of(project.joinpath(*_FILE)) is None:
        return None
    data = read_json(path_within(project, *_FILE), _SCHEMA, advice="Delete it and search again.")
    return NotFound(
        refusals=tuple(map(_refusal, data["refused"][:_MAX_SHOWN])),
        candidates=tuple(_candidate(project, entry) for entry in data.get("candidates", ())[:_MAX_SHOWN]),
    )


def read_offer(project: Path) -> NotFound:
    """Return the prompts that were not found and for which another model is offered.

    Raises
    ------
    PromptError
        When there are none.
    FormatError
        When the file cannot be read.
    """
    not_found = read_not_found(project)
    if not_found is None or not not_found.offer:
        raise PromptError("No word was refused for which another model is offered. Ask for a word first.")
    return not_found


def _refusal(entry: dict[str, Any]) -> Refusal:
    def few(name: str) -> tuple[str, ...]:
        return tuple(text[:_MAX_TEXT] for text in entry.get(name, ())[:_MAX_SUGGESTIONS])

    texts = (entry["message"], entry["text"], entry.get("offer", ""))
    message, text, offer = (one[:_MAX_TEXT] for one in texts)
    return Refusal(message, text, few("suggestions"), few("objects"), offer)


def _candidate(project: Path, entry: dict[str, Any]) -> Candidate:
    return Candidate(
        number=entry["number"],
        text=entry["text"][:_MAX_TEXT],
        score=float(entry["score"]),
        photo=entry["photo"][:_MAX_TEXT],
        picture=path_within(project, entry["picture"]),
        object_id=(entry.get("object") or "")[:_MAX_TEXT],
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
