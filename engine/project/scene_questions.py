"""Words asked of a scene while it is trained: what is asked, and its answer, for command line, page and Blender."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import FormatError, PromptError
from ..core.files import check, path_within
from ..core.words import split_texts

_MAX_TEXTS = 5
"""Texts of a question: each is looked for in many photos, and the training waits for its share of the processor."""
_OUTPUTS = {"step": int, "found": [{"text": str, "photo": str, "picture": str}], "refused": {str: str}}


@dataclass(frozen=True)
class Found:
    """A thing that a text names: its photo, and what the photo shows of it, in a picture with darkened surroundings."""

    text: str
    photo: str
    picture: Path


@dataclass(frozen=True)
class Answers:
    """What the scene so far answers.

    Attributes
    ----------
    step : int
        Finished steps of the training.
    found : tuple of Found
    refused : dict of str to str
        Reason by text.
    """

    step: int
    found: tuple[Found, ...]
    refused: dict[str, str]

    def outputs(self) -> dict[str, Any]:
        """Return the answers as values of JSON, which `read_answers` reads."""
        found = [{"text": one.text, "photo": one.photo, "picture": str(one.picture)} for one in self.found]
        return {"step": self.step, "found": found, "refused": self.refused}


def question_arguments(project: Path, words: str, out: Path) -> list[str]:
    """Return the engine's arguments that ask `words` of a scene; the pictures of the answer go into the folder `out`.

    Raises
    ------
    PromptError
        When the words name nothing or too many things.
    """
    count = len(split_texts(words))
    if not count:
        raise PromptError(f"{words!r} names nothing. Write for example: vase, teapot.")
    if count > _MAX_TEXTS:
        raise PromptError(f"A question has at most {_MAX_TEXTS} texts. Ask for fewer things.")
    # In this form, words that begin with a dash are no option.
    return ["ask", str(project), f"--prompt={words}", f"--out={out}"]


def read_answers(outputs: Mapping[str, Any], out: Path) -> Answers:
    """Return the answers of `Answers.outputs`, with their pictures in the folder `out` that was asked for.

    Raises
    ------
    FormatError
        When they have another form.
    """
    if problem := check(outputs, _OUTPUTS):
        raise FormatError(f"The engine's answer cannot be read ({problem}). Ask again.")
    pictures = [path_within(out, Path(one["picture"]).name) for one in outputs["found"]]
    found = [Found(one["text"], one["photo"], file) for one, file in zip(outputs["found"], pictures, strict=True)]
    return Answers(outputs["step"], tuple(found), dict(outputs["refused"]))
