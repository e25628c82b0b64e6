"""``vocabulary``: lists, forgets, exports and imports the words that the user's own objects have taught."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

from ...core.errors import PromptError, SettingsError
from ...core.events import Emit, Finished, StopCheck
from ...project.folder import ProjectFolder
from ...project.own_words import OwnWords, set_learning
from .scene_options import add_own_words_option, own_words_of

NAME = "vocabulary"
HELP = (
    "List, forget, export or import the words that your own objects have taught; let a project learn, or stop it. "
    "Nothing of it leaves this computer unless you export it."
)
EXAMPLE = "python -m engine vocabulary learn scene"

_TAKES = {
    "list": "",
    "forget": "a word",
    "export": "a file",
    "import": "a file",
    "learn": "a project",
    "stop": "a project",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument(
        "action", choices=tuple(_TAKES),
        help="learn, stop: from now on, the project teaches and uses your own vocabulary, or neither",
    )  # fmt: skip
    parser.add_argument(
        "what", nargs="?", help="forget: the word; export, import: the file; learn, stop: the project folder"
    )
    add_own_words_option(parser)


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Carry out the action."""
    takes = _TAKES[options.action]
    if bool(takes) != (options.what is not None):
        raise SettingsError(f"`vocabulary {options.action}` takes {takes or 'nothing more'}.")
    if options.action in ("learn", "stop"):
        message, outputs = _set_learning(Path(options.what), options.action == "learn")
    else:
        message, outputs = _ACTIONS[options.action](own_words_of(options), options.what)
    emit(Finished(message, outputs))
    return 0


def _set_learning(folder: Path, learns: bool) -> tuple[str, dict[str, Any]]:
    with ProjectFolder.open_existing(folder) as project:
        set_learning(project, learns)
    said = (
        "learns from now on: objects that you name, click or accept teach their words, which this project then finds"
        if learns
        else "learns no longer and uses no word of your own vocabulary. What it taught stays; see `vocabulary forget`"
    )
    return f"{folder.name} {said}.", {"learns": learns}


def _list(own: OwnWords, _: str | None) -> tuple[str, dict[str, Any]]:
    counts = Counter((one.word, one.detector) for one in own.examples())
    words = [{"word": word, "detector": detector, "n_examples": n} for (word, detector), n in sorted(counts.items())]
    lines = [f"{word}: {_examples(n)} ({detector})" for (word, detector), n in sorted(counts.items())]
    return "\n".join(lines) or "Your own vocabulary is empty.", {"words": words, "file": str(own.file)}


def _forget(own: OwnWords, word: str) -> tuple[str, dict[str, Any]]:
    count = own.forget(word)
    return f"Forgot {word!r}, {_examples(count)}.", {"n_examples": count}


def _export(own: OwnWords, file: str) -> tuple[str, dict[str, Any]]:
    if not (count := own.export(Path(file))):
        raise PromptError("Your own vocabulary is empty, so nothing was exported.")
    return f"Exported {_examples(count)} to {file}.", {"n_examples": count, "file": file}


def _import(own: OwnWords, file: str) -> tuple[str, dict[str, Any]]:
    count = own.import_from(Path(file))
    return f"Imported {_examples(count)}.", {"n_examples": count}


_ACTIONS = {"list": _list, "forget": _forget, "export": _export, "import": _import}


def _examples(count: int) -> str:
    return "1 example" if count == 1 else f"{count} examples"
