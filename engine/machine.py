"""This machine: its cores, the memory that is free, and how much of it this process took. Standard library only."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Machine", "PeakMemory", "cpu_seconds", "describe_machine", "free_memory", "peak_memory"]

_CGROUP = Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class Machine:
    """What planning needs to know.

    Attributes
    ----------
    cores : int
        That this process may use.
    free_bytes : int or None
        Memory a new process could take without swapping; None where the system does not say.
    backend : str
        Which rasterizer trains.
    name : str
        Processor and system, part of the calibration's key.
    """

    cores: int
    free_bytes: int | None
    backend: str
    name: str


def describe_machine() -> Machine:
    """Return this machine as it is now."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    name = f"{platform.system()} {platform.machine()} {_processor()}, {cores} cores"
    return Machine(cores, free_memory(), "cpu", name)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def cpu_seconds() -> float:
    """Return the processor seconds of this process and its children that ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def free_memory() -> int | None:
    """Return the bytes a new process could take without swapping, None where the system does not say.

    Notes
    -----
    Linux: ``MemAvailable``, less where a container's limit (cgroup v2) leaves less. Windows: ``ullAvailPhys``. macOS:
    free, inactive and speculative pages of ``vm_stat``.
    """
    if sys.platform == "win32":
        return _free_on_windows()
    if sys.platform == "darwin":
        return _free_on_mac()
    available = _kibibytes("/proc/meminfo", "MemAvailable")
    if available is None:
        return None
    try:
        limit = int((_CGROUP / "memory.max").read_text())
        used = int((_CGROUP / "memory.current").read_text())
    except (OSError, ValueError):  # No container, or "max": no limit.
        return available
    return max(0, min(available, limit - used))


def _kibibytes(file: str, name: str) -> int | None:
    """Return the bytes that ``name: 123 kB`` stands for in a file of /proc."""
    try:
        lines = Path(file).read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    found = (line.split() for line in lines if line.startswith(name + ":"))
    return next((1024 * int(words[1]) for words in found), None)


def _free_on_windows() -> int | None:
    class Status(ctypes.Structure):
        _fields_ = [("size", ctypes.c_ulong), ("load", ctypes.c_ulong)] + [
            (name, ctypes.c_ulonglong)
            for name in ("total", "available", "page_total", "page_free", "virtual_total", "virtual_free", "extended")
        ]

    status = Status()
    status.size = ctypes.sizeof(Status)
    if not ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status)):  # type: ignore[attr-defined, unused-ignore]
        return None
    return int(status.available)


def _free_on_mac() -> int | None:
    try:
        text = subprocess.run(["vm_stat"], capture_output=True, text=True, check=True, timeout=10).stdout
        page = int(text.split("page size of ")[1].split()[0])
        counts = {
            key.strip(): int(value.strip().rstrip("."))
            for key, _, value in (line.partition(":") for line in text.splitlines()[1:])
            if value.strip().rstrip(".").isdigit()
        }
        return page * sum(counts[name] for name in ("Pages free", "Pages inactive", "Pages speculative"))
    except (OSError, subprocess.SubprocessError, IndexError, KeyError, ValueError):
        return None


def peak_memory() -> int | None:
    """Return the most bytes this process held at once so far (since the last reset on Linux), None when not known."""
    if sys.platform == "win32":
        return _peak_on_windows()
    if sys.platform.startswith("linux"):
        # Unlike ru_maxrss this starts anew when it is reset.
        return _kibibytes("/proc/self/status", "VmHWM")
    import resource

    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)  # Bytes on macOS.


def _peak_on_windows() -> int | None:
    class Counters(ctypes.Structure):
        _fields_ = [("size", ctypes.c_ulong), ("faults", ctypes.c_ulong)] + [
            (name, ctypes.c_size_t)
            for name in ("peak", "now", "peak_paged", "paged", "peak_nonpaged", "nonpaged", "pagefile", "peak_pagefile")
        ]

    counters = Counters()
    counters.size = ctypes.sizeof(Counters)
    process = ctypes.c_void_p(-1)  # The pseudo handle of this process.
    found = ctypes.windll.psapi.GetProcessMemoryInfo(  # type: ignore[attr-defined, unused-ignore]
        process, ctypes.byref(counters), counters.size
    )
    return int(counters.peak) if found else None


@dataclass
class PeakMemory:
    """The peak of one stretch of work, filled in at its end; None where the system cannot tell it."""

    bytes: int | None = None

    @classmethod
    @contextlib.contextmanager
    def of(cls) -> Iterator[PeakMemory]:
        """Measure the peak of the block.

        Notes
        -----
        Linux resets the peak (``clear_refs``). Elsewhere it only ever rises: when the block did not raise it, its own
        peak is not known, and is not told.
        """
        found = cls()
        was_reset = _reset_peak()
        before = peak_memory()
        yield found
        after = peak_memory()
        if after is not None and (was_reset or (before is not None and after > before)):
            found.bytes = after


def _reset_peak() -> bool:
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return False
    return True
