"""Names of jobs, in the words of their buttons."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bpy.app.translations import pgettext_n

from ...engine.core.words import split_texts
from ..blender.problems import plain_text
from ..language.translations import translated

_MAX_LENGTH = 40
"""Characters of a name: a command stored by another program may hold any text."""
_EDIT = "edit"
_REST = {
    _EDIT: pgettext_n("store edits"),
    "--all": pgettext_n("find all"),
    "--complement": pgettext_n("isolate the background"),
    "--refine": pgettext_n("correct {}"),
    "--detail": pgettext_n("add detail to {}"),
    "--object": pgettext_n("make a mesh of {}"),
    "--prompt": pgettext_n("isolate {}"),
    "--name": pgettext_n("isolate {}"),
    "--accept": pgettext_n("isolate a candidate"),
    "--click": pgettext_n("isolate what was clicked"),
}
"""By word or option of a command of the engine, the most telling first; {}: the value of the option."""
_WITHOUT_VALUE = {"--detail": pgettext_n("add detail to all objects")}
"""The same where an option that may have a value has none."""


def job_name(kind: str, subject: Path, command: Sequence[str]) -> str:
    """Return what a job of a project does, in the language of the user, such as "isolate vase"."""
    if kind == "reconstruct":
        return translated("reconstruct {}", plain_text(subject.name)[:_MAX_LENGTH])
    options = {word.partition("=")[0]: word.partition("=")[2] for word in command}
    for option, text in _REST.items():
        if option in options:
            value = options[option]
            text = text if value else _WITHOUT_VALUE.get(option, text)
            value = ", ".join(split_texts(value)) if option == "--prompt" else value
            return translated(text, plain_text(value)[:_MAX_LENGTH]) if "{}" in text else translated(text)
    return f"{kind} {plain_text(subject.name)[:_MAX_LENGTH]}"


def stores_edits(command: Sequence[str]) -> bool:
    """Return whether a command of the engine is that of *Store Edits*."""
    return _EDIT in command
