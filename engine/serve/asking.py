"""Words that are asked of a scene while it is trained."""

from __future__ import annotations

import base64
import tempfile
from pathlib import Path
from typing import Any

from ..core.files import read_bytes
from ..project.scene_questions import question_arguments, read_answers
from .engine_call import call_engine
from .library import WebProject

_MAX_PICTURE = 64 << 20
"""Bytes of the picture of one thing, a part of a photo."""


def ask_scene(project: WebProject, words: str) -> dict[str, Any]:
    """Return what the scene so far shows of what `words` name.

    Returns
    -------
    dict
        ``step`` of the training; ``found``, a list of ``text``, ``photo`` and ``picture``, an address of the picture
        itself; ``refused``, reasons by text.

    Raises
    ------
    HeritageError
        When nothing is found, the scene is not being trained, or the words name nothing or too many things.
    """
    with tempfile.TemporaryDirectory(prefix="gaussian-heritage-") as name:
        folder = Path(name)
        arguments = [*question_arguments(project.project, words, folder), *project.own_words_options()]
        answers = read_answers(call_engine(arguments, "answer", advice="Ask for fewer things."), folder)
        found = [{"text": one.text, "photo": one.photo, "picture": _address_of(one.picture)} for one in answers.found]
    return {"step": answers.step, "found": found, "refused": answers.refused}


def _address_of(picture: Path) -> str:
    content = read_bytes(picture, max_bytes=_MAX_PICTURE, advice="Ask again.")
    return f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"
