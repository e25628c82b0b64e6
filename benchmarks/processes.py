"""What the system tells of running processes. Linux only."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

_TICKS = os.sysconf("SC_CLK_TCK")


def process_tree(pid: int) -> Iterator[int]:
    """Yield the number of a process and of those below it."""
    yield pid
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            for child in task.read_text(encoding="ascii").split():
                yield from process_tree(int(child))


def cpu_of(pid: int, *, with_ended_children: bool = False) -> float:
    """Return the CPU seconds of a process; 0 when it has ended."""
    with contextlib.suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        return sum(map(int, fields[11 : 15 if with_ended_children else 13])) / _TICKS
    return 0.0


def cpu_of_tree(pid: int) -> float:
    """Return the CPU seconds of a process and of all below it, those that have ended among them."""
    return sum(cpu_of(one, with_ended_children=True) for one in process_tree(pid))
