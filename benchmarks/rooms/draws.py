"""The rooms, and the append-only list of draws: which commit froze a method, when, why, and with which test rooms."""

from __future__ import annotations

import datetime
import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from engine.core.errors import FormatError, ProjectError
from engine.core.files import atomic_write, parse_json, read_json

from .repository import Repository

DRAWS_FILE = Path("benchmarks/rooms/draws.json")
"""Relative to the repository."""
FROZEN = ("engine", "demo", "benchmarks/rooms")
"""What a method and its measurement consist of: these folders may have no uncommitted change when it is frozen."""
RESULTS = "benchmarks/rooms/results"
KEPT_ROOMS = "demo/random_rooms/choosing"

N_CHOOSING_ROOMS = 8
MODEL_CHOOSING_SEEDS = range(12341, 12349)
"""Seeds of the choosing rooms whose exhibits are 3D models of other people; `make model-choosing-rooms`."""
N_TEST_ROOMS = 5
SHORT_COMMIT = 8
"""Digits of a commit in the names of its test rooms."""
_SEED_DIGITS = 8
_ENTRY = {"commit": str, "reason": str, "date": str, "seeds": [int]}
_ADVICE = "Restore it with git: entries are only ever appended."


@dataclass(frozen=True)
class Room:
    """A room that `demo/random_rooms/make_photos.py` renders.

    Attributes
    ----------
    name : str
        Of the folder below ``out/rooms`` and of the result.
    seed : int
    of_models : bool
        Whether its exhibits are 3D models of other people, not of our own catalogue.
    """

    name: str
    seed: int
    of_models: bool = False


CHOOSING_ROOMS = tuple(Room(f"room_{number}", number) for number in range(1, N_CHOOSING_ROOMS + 1))


@dataclass(frozen=True)
class Draw:
    """A draw of test rooms.

    Attributes
    ----------
    commit : str
        Full hash of the commit that froze the method.
    reason : str
    date : str
        Day of the draw, YYYY-MM-DD.
    seeds : tuple of int
        `test_seeds` of the commit.
    """

    commit: str
    reason: str
    date: str
    seeds: tuple[int, ...]

    @property
    def test_rooms(self) -> tuple[Room, ...]:
        """The test rooms of this draw."""
        return self._rooms("test", self.seeds, of_models=False)

    @property
    def model_rooms(self) -> tuple[Room, ...]:
        """Further test rooms, whose exhibits are 3D models of other people."""
        return self._rooms("models", test_seeds(self.commit, "model room"), of_models=True)

    def _rooms(self, word: str, seeds: Sequence[int], *, of_models: bool) -> tuple[Room, ...]:
        names = (f"{word}_{self.commit[:SHORT_COMMIT]}_{number}" for number in range(1, len(seeds) + 1))
        return tuple(Room(name, seed, of_models) for name, seed in zip(names, seeds, strict=True))


def test_seeds(commit: str, what: str = "test room") -> tuple[int, ...]:
    """Return the seeds of the test rooms of a commit, given by its full hash.

    Notes
    -----
    Seed i, from 1 to 5, is the number that the first 8 hexadecimal digits of the SHA-256 of ``"<hash> <what> <i>"``
    make. A seed of a choosing room is skipped: further i are taken until there are five.
    """
    taken = {*(room.seed for room in CHOOSING_ROOMS), *MODEL_CHOOSING_SEEDS}
    seeds: list[int] = []
    number = 0
    while len(seeds) < N_TEST_ROOMS:
        number += 1
        seed = int(hashlib.sha256(f"{commit} {what} {number}".encode()).hexdigest()[:_SEED_DIGITS], 16)
        if seed not in taken:
            seeds.append(seed)
    return tuple(seeds)


test_seeds.__test__ = False  # type: ignore[attr-defined]  # pytest takes every imported test_* for a test


def rooms_of(draw: Draw, which: str) -> tuple[Room, ...]:
    """Return the rooms that a draw is measured in: ``choosing``, ``test``, both by ``all``, or ``models``."""
    if which == "models":
        return draw.model_rooms
    choosing = CHOOSING_ROOMS if which in ("choosing", "all") else ()
    return (*choosing, *(draw.test_rooms if which in ("test", "all") else ()))


def read_draws(repository: Path) -> tuple[Draw, ...]:
    """Return all draws, the oldest first.

    Raises
    ------
    FormatError
        When the file cannot be read, its seeds are not those of its commits, or two draws have the same commit.
    """
    file = repository / DRAWS_FILE
    return _checked(read_json(file, [_ENTRY], advice=_ADVICE), str(file))


def _checked(entries: Sequence[dict[str, object]], source: str) -> tuple[Draw, ...]:
    draws: list[Draw] = []
    for number, entry in enumerate(entries, 1):
        commit, seeds = str(entry["commit"]), entry["seeds"]
        what = f"{source} cannot be used: draw {number}"
        if len(commit) != 40 or any(digit not in "0123456789abcdef" for digit in commit):
            raise FormatError(f"{what} names {commit[:50]!r}, which is not the full hash of a commit. {_ADVICE}")
        if seeds != list(test_seeds(commit)):
            raise FormatError(f"{what} has seeds that do not follow from its commit {commit[:12]}. {_ADVICE}")
        if any(draw.commit == commit for draw in draws):
            raise FormatError(f"{what} draws the commit {commit[:12]} a second time. {_ADVICE}")
        draws.append(Draw(commit, str(entry["reason"]), str(entry["date"]), test_seeds(commit)))
    return tuple(draws)


def rewritten_draw(repository: Repository) -> str | None:
    """Return what is wrong when an earlier version of the list is not the beginning of the present one, else None.

    Raises
    ------
    FormatError
        When the present list cannot be used.
    """
    present = read_draws(repository.root)
    for commit, text in repository.versions_of(DRAWS_FILE):
        if text is None:
            return f"The commit {commit[:12]} deleted {DRAWS_FILE}"
        source = f"{DRAWS_FILE} of the commit {commit[:12]}"
        before = _checked(parse_json(text, [_ENTRY], source=source, advice=_ADVICE), source)
        if present[: len(before)] != before:
            return f"{DRAWS_FILE} changed or left out a draw that it had in the commit {commit[:12]}"
    return None


def draw_now(repository: Repository, reason: str) -> Draw:
    """Freeze the present commit: return its draw, which is appended to the list unless it is there.

    Raises
    ------
    ProjectError
        When there are uncommitted changes, or when earlier draws are not as they were.
    """
    commit = repository.head()
    draws = read_draws(repository.root)
    known = next((draw for draw in draws if draw.commit == commit), None)
    if known is not None:
        return known
    changed = repository.changed(FROZEN, without=(RESULTS, KEPT_ROOMS))
    if changed:
        raise ProjectError(
            f"The method cannot be frozen: {changed[0]} has changes that are not committed"
            + (f", and {len(changed) - 1} more files" if len(changed) > 1 else "")
            + ". Commit them first."
        )
    problem = rewritten_draw(repository)
    if problem:
        raise ProjectError(f"{problem}. {_ADVICE}")
    if not reason.strip():
        raise ProjectError('A draw needs a reason. Write for example: --draw "opaque scenes".')
    draw = Draw(commit, reason.strip(), datetime.date.today().isoformat(), test_seeds(commit))
    append_draw(repository.root, draw)
    return draw


def append_draw(repository: Path, draw: Draw) -> None:
    """Append a draw to the list.

    Raises
    ------
    FormatError, DiskError
        When the list cannot be read or written.
    """
    entries = [asdict(one) for one in (*read_draws(repository), draw)]
    lines = ",\n".join(" " + json.dumps(entry, ensure_ascii=False) for entry in entries)
    with atomic_write(repository / DRAWS_FILE, "w") as stream:
        stream.write(f"[\n{lines}\n]\n")
