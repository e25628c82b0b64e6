"""Work in shares: in processes of this computer, and on helpers, which are other computers that are free.

A share is a call of a function of the engine. It is given JSON values, and what it makes is in files that helpers share
by the same paths. So what it makes does not depend on where it is called, and a share that is lost is called again.
"""

from __future__ import annotations

import contextlib
import itertools
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from .child_process import ChildBeside, child_beside
from .errors import Cancelled
from .events import StopCheck

Arguments = dict[str, Any]
Item = TypeVar("Item")

_ROUNDS = 3
"""Shares for each place where one can be called, so that a slower computer gets fewer."""
_POLL_SECONDS = 0.1


@dataclass(frozen=True)
class Need:
    """What a share takes: cores, and bytes of memory."""

    cores: int
    memory: int


class HelperCall(Protocol):
    """Shares on a helper, called at the same time."""

    @property
    def finished(self) -> bool:
        """Whether they have ended or were lost."""

    def results(self) -> list[Any] | None:
        """Return what the function returned for each share; None when they were lost, or failed there."""

    def end(self) -> None:
        """End the shares, if they still run."""


class Helper(Protocol):
    """A computer that is free."""

    def places(self, need: Need) -> int:
        """Return how many shares it can call at the same time."""

    def begin(self, function: str, shares: Sequence[Arguments], need: Need, *, what: str) -> HelperCall:
        """Call the function for each share, see `run_in_child`."""


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


def _free() -> Sequence[Helper]:
    helpers = _HELPERS.get()
    return () if helpers is None else helpers().free()


def divided(
    items: Sequence[Item], processes: int, need: Need, *, least: int, most: int = sys.maxsize
) -> list[list[Item]]:
    """Return shares of neighbouring items: one for each process, three for each place where helpers are free.

    Parameters
    ----------
    items : sequence
    processes : int
        Shares that this computer calls at the same time.
    need : Need
    least : int
        Items of a share, unless there is one share.
    most : int
        Number of shares.
    """
    places = sum(helper.places(need) for helper in _free())
    wanted = _ROUNDS * (processes + places) if places else processes
    count = max(1, min(wanted, len(items) // least, most))
    bounds = [len(items) * number // count for number in range(count + 1)]
    return [list(items[start:end]) for start, end in itertools.pairwise(bounds)]


def run_shares(
    function: str,
    shares: Sequence[Callable[[], Arguments]],
    need: Need,
    *,
    what: str,
    processes: int,
    finished: Callable[[int, Any], None] = lambda number, result: None,
    watch: Callable[[], None] = lambda: None,
    should_stop: StopCheck,
) -> None:
    """Call a function for each share, in order of their numbers where they begin.

    Parameters
    ----------
    function : str
        See `run_in_child`.
    shares : sequence of callable
        Each returns the arguments of its share when it begins, and again if it was lost.
    need : Need
        Of each share, on a helper.
    what : str
        See `run_in_child`.
    processes : int
        Shares that this computer calls at the same time, at least 1.
    finished : callable
        Receives number and result of each share that has ended.
    watch : callable
        Called ten times a second.
    should_stop : StopCheck

    Raises
    ------
    HeritageError
        What the function raised on this computer, and what `child_beside` raises. All shares have ended then.
    Cancelled
        When `should_stop` returned True.
    """
    waiting = list(range(len(shares)))
    here: dict[int, ChildBeside] = {}
    away: list[tuple[list[int], HelperCall]] = []
    with contextlib.ExitStack() as running:
        while waiting or here or away:
            while waiting and len(here) < processes:
                number = waiting.pop(0)
                here[number] = running.enter_context(child_beside(function, shares[number](), what=what))
            for helper in _free() if waiting else ():
                taken, waiting = waiting[: helper.places(need)], waiting[helper.places(need) :]
                if taken:
                    call = helper.begin(function, [shares[number]() for number in taken], need, what=what)
                    running.callback(call.end)
                    away.append((taken, call))
            for number in [number for number, child in here.items() if child.finished]:
                finished(number, here.pop(number).end())
            for taken, call in [one for one in away if one[1].finished]:
                away.remove((taken, call))
                results = call.results()
                if results is None:
                    waiting = taken + waiting
                    continue
                for number, result in zip(taken, results, strict=True):
                    finished(number, result)
            watch()
            if should_stop():
                raise Cancelled(f"Stopped while {what}. The next run continues from here.")
            if waiting or here or away:
                time.sleep(_POLL_SECONDS)
