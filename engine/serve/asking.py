"""Words that are asked of a scene while it is trained."""

from __future__ import annotations

import base64
import tempfile
from pathlib import Path
from typing import Any

from ..core.errors import PromptError
from ..core.files import read_bytes
from ..core.words import split_texts
from .engine_call import call_engine
from .library import WebProject

_MAX_PICTURE = 64 << 20
"""Bytes of the picture of one thing, a part of a photo."""
_MAX_TEXTS = 5
"""Texts of a question: each is looked for in many photos, and others wait for their answers."""


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
    count = len(split_texts(words))
    if not count:
        raise PromptError(f"{words!r} names nothing. Write for example: vase, teapot.")
    if count > _MAX_TEXTS:
        raise PromptError(f"A question has at most {_MAX_TEXTS} texts. Ask for fewer things.")
    with tempfile.TemporaryDirectory(prefix="gaussian-heritage-") as folder:
        arguments = ["ask", str(project.project), f"--prompt={words}", f"--out={folder}", *project.own_words_options()]
        answer = call_engine(arguments, "answer", advice="Ask for fewer things.")
        found = [{**one, "picture": _address_of(Path(one["picture"]))} for one in answer["found"]]
    return {"step": answer["step"], "found": found, "refused": answer["refused"]}


def _address_of(picture: Path) -> str:
    content = read_bytes(picture, max_bytes=_MAX_PICTURE, advice="Ask again.")
    return f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"
