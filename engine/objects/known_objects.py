"""Objects of a project that a prompt finds again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..core.arrays import Float32
from ..core.words import normalised
from ..project.objects import ObjectRecord, list_objects, load_membership

BACKGROUND = "background"
"""Prompt kind, name and id of the background."""


def found_again(name: str, same: ObjectRecord, count: int) -> str:
    """Return a sentence that `count` Gaussians that were to be stored as `name` are the object `same`, which exists."""
    if count != same.n_gaussians:
        return f"{name!r} is {same.name!r}, which was changed since it was isolated, so no second object was stored."
    which = "exists already with" if name == same.name else "has"
    owner = "these Gaussians" if name == same.name else f"the Gaussians of {same.name!r}, which exists already"
    return f"{name!r} {which} exactly {owner}, so no second object was stored."


def was_changed(record: ObjectRecord, asked: dict[str, Any]) -> bool:
    """Return whether the object was asked for by the text of a prompt, and may have been corrected or resized since."""
    text, own = (normalised(str(prompt.get("text", ""))) for prompt in (asked, record.prompt))
    return bool(text) and text == own and bool(record.refined or record.levels)


def stored_memberships(project: Path, count: int) -> dict[str, Float32]:
    """Return the memberships, [count], of all objects of a scene with `count` Gaussians by id, but of the background.

    Raises
    ------
    FormatError
        When an object is damaged.
    """
    return {
        record.id: load_membership(project, record.id)
        for record in list_objects(project)
        if record.prompt.get("kind") != BACKGROUND and record.n_scene_gaussians == count
    }
