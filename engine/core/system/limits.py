"""Limits of time and memory that the system itself keeps, and what an exit code says about them.

Windows has neither of those of POSIX; there the parent process alone bounds the time.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

_WINDOWS_NO_MEMORY = (0xC0000017, 0xC000012D)
"""STATUS_NO_MEMORY and STATUS_COMMITMENT_LIMIT."""


def killed_for_time(code: int) -> bool:
    """Return whether an exit code says that `wall_seconds_limited` ended the process."""
    return sys.platform != "win32" and code == -signal.SIGALRM


def killed_for_memory(code: int) -> bool:
    """Return whether an exit code says that the system ended the process when memory was full."""
    if sys.platform == "win32":
        return code & 0xFFFFFFFF in _WINDOWS_NO_MEMORY
    # Linux kills the largest process with SIGKILL when all memory is used.
    return code == -signal.SIGKILL


def exit_cause(code: int) -> str:
    """Return what ended a process, from its exit code: the name of a signal, or the code as Windows' tables list it."""
    if sys.platform == "win32":
        return f"exit code {code:#010x}" if code > 0xFFFF else f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit code {code}"


def ignore_signals_of_the_terminal() -> None:
    """Ignore the signals that ask to stop: a parent decides when this process ends."""
    names = {"SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"}
    for number in signal.valid_signals():
        if isinstance(number, signal.Signals) and number.name in names:
            signal.signal(number, signal.SIG_IGN)


def no_core_dumps() -> None:
    """Forbid files with the memory of this process when it crashes."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def wall_seconds_limited(seconds: float) -> None:
    """Let the kernel end this process after `seconds`, even when a library never returns; 0 lifts the limit."""
    if sys.platform != "win32":
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, seconds)


def cpu_seconds_limited(seconds: float) -> None:
    """Let the kernel end this process after `seconds` more of CPU time."""
    if sys.platform != "win32":
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_CPU)
        soft = int(time.process_time() + seconds) + 1
        # The signal ends the process, also while a library works.
        resource.setrlimit(resource.RLIMIT_CPU, (soft if hard == resource.RLIM_INFINITY else min(soft, hard), hard))


def limit_memory(extra: int) -> Callable[[], None] | None:
    """Allow `extra` bytes more of address space than this process has now, and return what lifts the limit.

    Returns
    -------
    callable or None
        None where the system has no such limit: on all but Linux.
    """
    if sys.platform != "linux":
        return None
    import resource

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    before = soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    allowed = [pages * resource.getpagesize() + extra, *(one for one in before if one != resource.RLIM_INFINITY)]
    resource.setrlimit(resource.RLIMIT_AS, (min(allowed), hard))
    return lambda: resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@contextlib.contextmanager
def memory_limited(extra: int | None) -> Iterator[None]:
    """Limit the memory of this process while the block runs, see `limit_memory`; None is no limit."""
    lift = None if extra is None else limit_memory(extra)
    try:
        yield
    finally:
        # The answer about an exhausted memory needs some memory.
        if lift is not None:
            lift()
