"""The user's own vocabulary: words that stored objects taught, with how a detector describes these objects.

One file for all projects of a user, on this computer alone. It holds no photo, no name of a project and no path.
Standard library and NumPy only.
"""

from __future__ import annotations

import base64
import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Float32
from ..core.errors import FormatError, ProjectInUse, PromptError
from ..core.files import read_after_change, read_versioned, stamp_of, write_json
from ..core.words import normalised, similarly_spelt, singulars
from .folder import PROJECT_FILE, ProjectFolder, hold_mark

_VERSION = 1
_ADVICE = "Import a copy of it, or delete it to begin anew."
_SCHEMA: dict[str, Any] = {
    "version": int,
    "examples": [
        {"word": str, "source": str, "state": str, "detector": str, "fingerprint": str, "created": str, "vector": str}
    ],
}
_MAX_EXAMPLES = 2000
"""Examples in a vocabulary: the file then has about 14 MB."""
_MAX_WORD = 100
_MAX_WIDTH = 8192
_WAIT_SECONDS = 10.0
"""How long another program may write the vocabulary; it takes a fraction of a second."""
_SETTING = "learns_words"


@dataclass(frozen=True)
class Example:
    """One object that taught a word.

    Attributes
    ----------
    word : str
        As the user wrote it.
    source : str
        Hash that names the object, of which nothing can be read.
    state : str
        Hash of what the object was when it was described.
    detector, fingerprint : str
        Name of the detector that described it, and what tells one version of it from another.
    created : str
        ISO 8601 time in UTC.
    vector : array of shape [D], float32
        By `engine.objects.taught`.
    """

    word: str
    source: str
    state: str
    detector: str
    fingerprint: str
    created: str
    vector: Float32


class OwnWords:
    """The user's own vocabulary.

    Parameters
    ----------
    file : Path
        Need not exist.
    """

    def __init__(self, file: Path) -> None:
        self.file = file

    def examples(self, fingerprint: str | None = None) -> list[Example]:
        """Return the examples, all or those of one version of a detector, in the order in which they were taught.

        Raises
        ------
        FormatError
            When the file is damaged.
        """
        found = _read(self.file) if self.file.exists() else []
        return [one for one in found if fingerprint is None or one.fingerprint == fingerprint]

    def means_of(self, word: str, fingerprint: str) -> tuple[Float32, Float32]:
        """Return the mean of the examples of a word, [1, D], and those of each other word, [W, D].

        The first has no row for a word that was not taught.

        Raises
        ------
        FormatError
            When the file is damaged.
        """
        by_word: dict[str, list[Float32]] = {}
        for one in self.examples(fingerprint):
            name = next((known for known in by_word if same_word(known, one.word)), one.word)
            by_word.setdefault(name, []).append(one.vector)
        means = {name: np.mean(rows, axis=0) for name, rows in by_word.items()}
        own = [mean for name, mean in means.items() if same_word(name, word)]
        others = [mean for name, mean in means.items() if not same_word(name, word)]
        none = np.zeros((0, len(next(iter(means.values()), "-"))), np.float32)
        return np.array(own, np.float32) if own else none, np.array(others, np.float32) if others else none

    def add(self, examples: Sequence[Example]) -> None:
        """Add examples; one of the same object and detector takes the place of an earlier one.

        Raises
        ------
        PromptError
            When there would be too many.
        FormatError
            When the file is damaged.
        DiskError, ProjectInUse
            When it cannot be written.
        """
        with self._held():
            new = {(one.source, one.fingerprint): one for one in examples}
            kept = [one for one in self.examples() if (one.source, one.fingerprint) not in new]
            if len(kept) + len(new) > _MAX_EXAMPLES:
                raise PromptError(
                    f"Your own vocabulary has {len(kept)} examples, and at most {_MAX_EXAMPLES} are kept. Forget words "
                    "that you do not need: `python -m engine vocabulary forget WORD`."
                )
            _require_sound(self.file, [*kept, *new.values()])
            _write(self.file, [*kept, *new.values()])

    def forget(self, word: str) -> int:
        """Forget a word with all its examples, and return how many these were.

        Raises
        ------
        PromptError
            When the vocabulary does not have it.
        FormatError, DiskError, ProjectInUse
            As of `add`.
        """
        with self._held():
            known = self.examples()
            kept = [one for one in known if not same_word(one.word, word)]
            if len(kept) == len(known):
                words = sorted({one.word for one in known})
                near = similarly_spelt([normalised(word)], words) or words[:5]
                hint = f"It has {', '.join(near)}." if near else "It is empty."
                raise PromptError(f"Your own vocabulary does not have {word!r}. {hint}")
            _write(self.file, kept)
            return len(known) - len(kept)

    def export(self, file: Path) -> int:
        """Write a copy unless it would be empty, and return the number of examples.

        Errors as of `examples`, and `DiskError`.
        """
        found = self.examples()
        if found:
            _write(file, found)
        return len(found)

    def import_from(self, file: Path) -> int:
        """Add the examples of an exported file, and return their number; errors as of `add`."""
        found = _read(file)
        self.add(found)
        return len(found)

    @contextlib.contextmanager
    def _held(self) -> Iterator[None]:
        """Hold the vocabulary while it is changed: jobs of several projects may teach at the same time."""
        lock, deadline = self.file.with_name(f"{self.file.name}.lock"), time.monotonic() + _WAIT_SECONDS
        while (held := hold_mark(lock)) is None:
            if time.monotonic() > deadline:
                raise ProjectInUse(f"Another job is writing {self.file}. Try again when it is done.")
            time.sleep(0.02)
        try:
            yield
        finally:
            held.close()


def same_word(first: str, second: str) -> bool:
    """Return whether two texts are the same word: case, articles and the plural make no difference."""
    return bool(set(singulars(normalised(first))) & set(singulars(normalised(second))) - {""})


def learns_words(project: ProjectFolder) -> bool:
    """Return whether a project teaches and uses the user's own vocabulary. It does not unless the user says so."""
    return bool(project.get(_SETTING, False))


@read_after_change(PROJECT_FILE)
def read_learning(project: Path) -> bool:
    """Return the same of the project in a folder, which is read again after it was changed; False for no project.

    Raises
    ------
    FormatError
        When it is damaged.
    """
    if stamp_of(project / PROJECT_FILE) is None:
        return False
    return learns_words(ProjectFolder.open_existing(project))


def set_learning(project: ProjectFolder, learns: bool) -> None:
    """Store whether a project teaches and uses the user's own vocabulary; raises `DiskError`."""
    project.put(_SETTING, learns)


def _read(file: Path) -> list[Example]:
    data = read_versioned(file, _SCHEMA, version=_VERSION, advice=_ADVICE)
    names = [name for name in _SCHEMA["examples"][0] if name != "vector"]
    found = [Example(**{name: one[name] for name in names}, vector=_vector(one["vector"])) for one in data["examples"]]
    _require_sound(file, found)
    return found


def _require_sound(file: Path, examples: Sequence[Example]) -> None:
    if len(examples) > _MAX_EXAMPLES:
        raise FormatError(
            f"{file} has {len(examples)} examples, more than the {_MAX_EXAMPLES} that are kept. {_ADVICE}"
        )
    widths: dict[str, int] = {}
    for number, one in enumerate(examples, 1):
        width = widths.setdefault(one.fingerprint, len(one.vector))
        if not (0 < len(one.vector) == width) or not normalised(one.word) or len(one.word) > _MAX_WORD:
            raise FormatError(f"Example {number} of {file} is damaged or does not fit the others. {_ADVICE}")


def _vector(text: str) -> Float32:
    """Return a stored vector; empty for a damaged one."""
    try:
        data = base64.b64decode(text, validate=True)
    except ValueError:
        return np.zeros(0, np.float32)
    if len(data) % 2 or len(data) > 2 * _MAX_WIDTH:
        return np.zeros(0, np.float32)
    vector = np.frombuffer(data, "<f2").astype(np.float32)
    return vector if np.isfinite(vector).all() else np.zeros(0, np.float32)


def _write(file: Path, examples: Sequence[Example]) -> None:
    def entry(one: Example) -> dict[str, Any]:
        packed = base64.b64encode(one.vector.astype("<f2").tobytes()).decode("ascii")
        return {**vars(one), "vector": packed}

    write_json(file, {"version": _VERSION, "examples": [entry(one) for one in examples]}, private=True)
