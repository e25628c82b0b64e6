"""Work in shares: in processes of this computer, and on helpers, which are other computers that are free.

The work is a number of items. Each process calls the same function, which takes items that no other has taken until
none is left. What it makes is in files that helpers share by the same paths, so it does not matter who made it. What a
lost process had taken is missing at the end, and whoever asked for the work does that again.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from .child_process import child_beside
from .errors import Cancelled
from .events import StopCheck

_POLL_SECONDS = 0.1


@dataclass(frozen=True)
class Need:
    """What a process takes: cores, and bytes of memory."""

    cores: int
    memory: int


class HelperCall(Protocol):
    """Processes on a helper."""

    @property
    def works(self) -> bool:
        """Whether they have begun, have not ended, and are not lost."""

    def end(self) -> None:
        """End them, if they still run."""


class Helper(Protocol):
    """A computer that is free."""

    def places(self, need: Need) -> int:
        """Return how many processes it has room for."""

    def begin(self, function: str, arguments: dict[str, Any], count: int, need: Need, *, what: str) -> HelperCall:
        """Call the function in `count` processes, see `run_in_child`."""


class Helpers(Protocol):
    """Computers that may help."""

    def free(self) -> Sequence[Helper]:
        """Return those that do nothing now."""


_HELPERS: ContextVar[Callable[[], Helpers] | None] = ContextVar("helpers", default=None)


@contextlib.contextmanager
def helped_by(helpers: Callable[[], Helpers]) -> Iterator[None]:
    """Let `run_shares` use helpers in the block; `helpers` is called where it is about to."""
    token = _HELPERS.set(helpers)
    try:
        yield
    finally:
        _HELPERS.reset(token)


def helper_places(need: Need) -> int:
    """Return how many processes the helpers that are free now have room for; 0 without helpers."""
    return sum(helper.places(need) for helper in _free())


def _free() -> Sequence[Helper]:
    helpers = _HELPERS.get()
    return () if helpers is None else helpers().free()


def taken_items(folder: Path, count: int) -> Iterator[int]:
    """Yield numbers below `count` that no other process has taken in `folder`, each when it is taken."""
    for number in range(count):
        with contextlib.suppress(FileExistsError):
            (folder / f"taken-{number}").mkdir()
            yield number


def count_taken(folder: Path) -> int:
    """Return how many items are taken."""
    return sum(1 for _ in folder.glob("taken-*"))


def run_shares(
    function: str,
    arguments: dict[str, Any],
    count: int,
    need: Need,
    *,
    folder: Path,
    what: str,
    processes: int,
    watch: Callable[[], None],
    should_stop: StopCheck,
) -> None:
    """Call a function that takes items in several processes until all items are taken and those who took them end.

    Parameters
    ----------
    function : str
        See `run_in_child`. It goes through `taken_items`.
    arguments : dict
    count : int
        Of the items.
    need : Need
        Of a process.
    folder : Path
        Where items are taken.
    what : str
        See `run_in_child`.
    processes : int
        Those of this computer, at least 1.
    watch : callable
        Called ten times a second, and at the end.
    should_stop : StopCheck

    Raises
    ------
    HeritageError
        What the function raised on this computer, and what `child_beside` raises. All processes have ended then.
    Cancelled
        When `should_stop` returned True.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as running:
        here = [running.enter_context(child_beside(function, arguments, what=what)) for _ in range(processes)]
        away: list[HelperCall] = []
        while here or any(call.works for call in away):
            left = count - count_taken(folder)
            for helper in _free() if left > 0 else ():
                room = min(helper.places(need), left)
                if room > 0:
                    away.append(helper.begin(function, arguments, room, need, what=what))
                    running.callback(away[-1].end)
            for child in [child for child in here if child.finished]:
                here.remove(child)
                child.end()
            watch()
            if should_stop():
                raise Cancelled(f"Stopped while {what}. The next run continues from here.")
            time.sleep(_POLL_SECONDS)
    watch()
