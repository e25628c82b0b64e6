"""Where the time of a command goes: wall and CPU seconds of its parts, named where the work is done.

`measured_parts` opens the account of a command, and ``with part("imports"):`` anywhere below it books the time of the
block to ``imports``, and to ``training/imports`` within ``with part("training"):``. Every second is booked once, to the
innermost part. Without an account, and in other threads, a part is not booked. Standard library only, and nothing of
the engine: every package is imported through it.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Parts:
    """The account of a command.

    Attributes
    ----------
    cpu_seconds : callable
        Returns the CPU seconds of this process and of its children that have ended, see `engine.core.system`.
    seconds : dict of str to [float, float]
        Wall and CPU seconds by the path of the part, such as ``training/imports``; ``""`` is what no part names.
    """

    cpu_seconds: Callable[[], float]
    seconds: dict[str, list[float]] = field(default_factory=dict)
    _path: str = ""
    _since: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        self._since = self._now()

    def _now(self) -> tuple[float, float]:
        return time.perf_counter(), self.cpu_seconds()

    def go_on_with(self, path: str) -> str:
        """Book the time since the last call to the part that ends here, and return its path."""
        now, before = self._now(), self._path
        booked = self.seconds.setdefault(before, [0.0, 0.0])
        for clock in range(2):
            booked[clock] += now[clock] - self._since[clock]
        self._since, self._path = now, path
        return before

    def within(self, name: str) -> str:
        """Return the path of a part of the present one, which is that of this name itself where imports import."""
        if self._path.rpartition("/")[2] == name:
            return self._path
        return f"{self._path}/{name}" if self._path else name

    def as_json(self) -> dict[str, Any]:
        """Return wall and CPU seconds by path, up to now, as JSON values."""
        self.go_on_with(self._path)
        return {path: [round(one, 4) for one in both] for path, both in self.seconds.items()}


_ACCOUNT: ContextVar[Parts | None] = ContextVar("account", default=None)


@contextlib.contextmanager
def measured_parts(cpu_seconds: Callable[[], float]) -> Iterator[Parts]:
    """Open the account of a command for the block; see `Parts`."""
    parts = Parts(cpu_seconds)
    token = _ACCOUNT.set(parts)
    try:
        yield parts
    finally:
        _ACCOUNT.reset(token)


@contextlib.contextmanager
def part(name: str) -> Iterator[None]:
    """Book the time of the block to the part `name` of what is done now."""
    parts = _ACCOUNT.get()
    if parts is None:
        yield
        return
    before = parts.go_on_with(parts.within(name))
    try:
        yield
    finally:
        parts.go_on_with(before)
