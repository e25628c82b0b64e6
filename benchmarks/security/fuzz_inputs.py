"""The damaged inputs of a reader: input number n of a seed is always the same, and found ones are kept in a folder."""

from __future__ import annotations

import hashlib
import itertools
import os
import random
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from .mutations import enlarged, mutated
from .reader import Reader

_STATES = ("missing", "empty", "folder", "dangling", "loop", "pipe", "unreadable")
"""What a file may be instead of damaged; the first inputs of each reader."""
_LARGE_TURNS = frozenset({len(_STATES), 100, 300, 700, 1500})
"""Inputs that are large, and show what a reader takes at most; far apart, because they take most of the time."""


@dataclass
class Workplace:
    """A folder with the input of a reader, which is made whole again after each damaged input."""

    reader: Reader
    folder: Path
    _valid: dict[str, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.restore()

    def restore(self) -> None:
        """Write the valid input; everything else in the folder is deleted."""
        _delete(self.folder)
        self.folder.mkdir(parents=True)
        if not self._valid:
            self.reader.write(self.folder)
            files = (path for path in self.folder.rglob("*") if path.is_file())
            self._valid = {path.relative_to(self.folder).as_posix(): path.read_bytes() for path in files}
        else:
            for name, data in self._valid.items():
                (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                (self.folder / name).write_bytes(data)

    def damage(self, seed: int, number: int) -> str:
        """Damage one file as input `number` says, and return its name."""
        files = self.reader.files
        name, turn = files[number % len(files)], number // len(files)
        path = self.folder / name
        if turn < len(_STATES) and not self.reader.takes_text:
            path.unlink()
            _put(path, _STATES[turn])
            return name
        rng = random.Random(f"{seed} {self.reader.name} {number}")
        damage = enlarged if turn in _LARGE_TURNS else mutated
        path.write_bytes(damage(self._valid[name], path.suffix[1:], rng))
        return name

    def replace(self, files: dict[str, Path]) -> None:
        """Take some files of the input from elsewhere."""
        for name, source in files.items():
            shutil.copyfile(source, self.folder / name)

    def heal(self, name: str) -> None:
        """Make a damaged file whole again; also what a reader did to the other files."""
        path = self.folder / name
        if not path.is_file() or path.is_symlink() or any(not (self.folder / other).is_file() for other in self._valid):
            self.restore()
        else:
            path.write_bytes(self._valid[name])


def quick_numbers(reader: Reader, count: int) -> list[int]:
    """Return the numbers of the first `count` inputs that are not large."""
    numbers = (number for number in itertools.count() if number // len(reader.files) not in _LARGE_TURNS)
    return list(itertools.islice(numbers, count))


def _delete(folder: Path) -> None:
    for path in folder.rglob("*") if folder.is_dir() else ():
        if not path.is_symlink():
            path.chmod(0o700)
    shutil.rmtree(folder, ignore_errors=True)


def _put(path: Path, state: str) -> None:
    match state:
        case "empty":
            path.touch()
        case "folder":
            path.mkdir()
        case "dangling":
            path.symlink_to("nowhere")
        case "loop":
            path.symlink_to(path.name)
        case "pipe" if hasattr(os, "mkfifo"):
            os.mkfifo(path)
        case "unreadable":
            path.touch()
            path.chmod(0)


@dataclass(frozen=True)
class Outcome:
    """How a reader ended: ``"accepted"``, ``"refused"`` (our error, or ignored) or ``"other"`` (any other exception).

    Attributes
    ----------
    kind : str
    error : str
        Type and text of another exception, and the line of our code that it came from.
    result : object
        What the reader returned.
    """

    kind: str
    error: str = ""
    result: object = None


def outcome_of(reader: Reader, folder: Path) -> Outcome:
    """Read the input in `folder`."""
    try:
        result = reader.read(folder)
    # pycolmap and NumPy raise exceptions of every type, and a reader must not end the process.
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        # By name: the add-on has modules of the engine of its own.
        if any(base.__name__ == "HeritageError" for base in type(error).__mro__):
            return Outcome("refused")
        return Outcome("other", f"{type(error).__name__} at {_place_of(error)}: {str(error)[:200]}")
    return Outcome("refused" if result is None else "accepted", result=result)


def _place_of(error: BaseException) -> str:
    """Return file and line of the innermost frame in our code."""
    place, trace = "?", error.__traceback__
    while trace is not None:
        file = Path(trace.tb_frame.f_code.co_filename)
        if {"engine", "gaussian_heritage_addon"} & set(file.parts) and "site-packages" not in file.parts:
            place = f"{file.parent.name}/{file.name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place


def corpus(folder: Path) -> Iterator[tuple[str, str, dict[str, Path]]]:
    """Yield the name of the reader, the name of the case and its damaged files, for each case in `folder`.

    A case is a folder ``<reader>/<case>`` with the damaged files of an input; the others are as the reader's entry
    writes them.
    """
    for case in sorted(folder.glob("*/*")):
        files = {path.relative_to(case).as_posix(): path for path in case.rglob("*") if path.is_file()}
        yield case.parent.name, case.name, files


def keep(folder: Path, reader: Reader, name: str, data: bytes) -> Path:
    """Keep a damaged file as a case of the corpus, and return its folder."""
    case = folder / reader.name / f"found-{hashlib.sha256(data).hexdigest()[:8]}"
    (case / name).parent.mkdir(parents=True, exist_ok=True)
    (case / name).write_bytes(data)
    return case
