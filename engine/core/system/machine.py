"""Cores, free memory, peak memory and memory of graphics cards of this machine. Standard library only."""

from __future__ import annotations

import contextlib
import ctypes
import ctypes.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from .kinds import describe_system
from .text import run_text

CORES_VARIABLE = "GAUSSIAN_HERITAGE_CORES"
"""Environment variable of a worker: numbers of the cores that its engines use, e.g. ``0,1``; by default all."""

_CGROUP = Path("/sys/fs/cgroup")
_OWN_GROUPS = Path("/proc/self/cgroup")
_GRAPHICS = Path("/sys/class/drm")


@dataclass(frozen=True)
class Machine:
    """Properties of a machine that the plan and the forecast depend on.

    Attributes
    ----------
    cores : int
        Processor cores that this process may use.
    free_bytes : int or None
        Memory that a new process could use without swapping; None where the system does not report it.
    backend : str
        Rasterizer that is used for training.
    name : str
        Processor and system, part of the calibration's key.
    """

    cores: int
    free_bytes: int | None
    backend: str
    name: str


def usable_cores() -> tuple[int, ...]:
    """Return the numbers of the processor cores that this process may use."""
    if sys.platform == "linux":
        return tuple(sorted(os.sched_getaffinity(0)))
    return tuple(range(os.cpu_count() or 1))


def use_cores(numbers: Iterable[int]) -> None:
    """Keep this process and the threads that it starts on these cores, where the system can do that.

    Raises
    ------
    OSError
        When this machine does not have them.
    """
    if sys.platform == "linux":
        os.sched_setaffinity(0, set(numbers))


def given_cores() -> tuple[int, ...]:
    """Return the numbers of the cores that `CORES_VARIABLE` names; without it, those that this process may use."""
    given = os.environ.get(CORES_VARIABLE, "")
    with contextlib.suppress(ValueError):
        return tuple(int(number) for number in given.split(",")) if given else usable_cores()
    return usable_cores()


def use_given_cores() -> None:
    """Keep this process and the threads that it starts on `given_cores`, where this machine has them."""
    with contextlib.suppress(OSError):
        use_cores(given_cores())


def has_nvidia_driver() -> bool:
    """Return whether this computer has a driver for NVIDIA's graphics cards."""
    if sys.platform == "darwin":
        return False
    library = "nvcuda" if sys.platform == "win32" else "cuda"
    return shutil.which("nvidia-smi") is not None or ctypes.util.find_library(library) is not None


def describe_machine() -> Machine:
    """Return the properties of this machine, with the memory that is free now."""
    cores = len(usable_cores())
    name = f"{describe_system()} {_processor()}, {cores} cores"
    return Machine(cores, free_memory(), "cpu", name)


def _processor() -> str:
    text = _text("/proc/cpuinfo")
    if not text:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")), "")


def card_memory(name: str) -> int | None:
    """Return the bytes of a graphics card's own memory, None where the system does not tell them.

    Parameters
    ----------
    name : str
        As the driver reports it. The smallest one counts where several cards have this name.

    Notes
    -----
    NVIDIA: ``nvidia-smi``. AMD on Linux: ``mem_info_vram_total``, where there is one such card. wgpu tells no sizes.
    """
    if name.startswith("NVIDIA"):
        command = ["nvidia-smi", "--query-gpu=name,memory.total", "--format=csv,noheader,nounits"]
        try:
            done = run_text(command, timeout=10)
        except (OSError, subprocess.SubprocessError):
            return None
        if done.returncode:
            return None
        rows = (line.rpartition(",") for line in done.stdout.splitlines())
        found = [int(size) << 20 for card, _, size in rows if card.strip() == name and size.strip().isdecimal()]
        return min(found, default=None)
    sizes = [_text(file).strip() for file in _GRAPHICS.glob("card*/device/mem_info_vram_total")]
    return int(sizes[0]) if name.startswith("AMD") and len(sizes) == 1 and sizes[0].isdecimal() else None


def cpu_seconds() -> float:
    """Return the CPU seconds of this process and of its finished child processes."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def free_memory() -> int | None:
    """Return the bytes that a new process could use without swapping, None where the system does not report them.

    Notes
    -----
    Linux: the smallest of ``MemAvailable``, what the limits of the control groups leave (containers, both versions),
    and what the limits of this process leave (``ulimit -v`` and ``-d``). Windows: ``ullAvailPhys``. macOS: free,
    inactive and speculative pages of ``vm_stat``, or the limits of this process.
    """
    if sys.platform == "win32":
        return _free_on_windows()
    available = _free_on_mac() if sys.platform == "darwin" else _kibibytes("/proc/meminfo", "MemAvailable")
    if available is None:
        return None
    return max(0, min([available, *_left_in_control_groups(), *_left_of_own_limits()]))


def _left_of_own_limits() -> list[int]:
    """Return the bytes that each limit of this process leaves."""
    import resource

    statm = _text("/proc/self/statm").split()
    # Without /proc, nothing is known about what is used already.
    pages = {resource.RLIMIT_AS: int(statm[0]), resource.RLIMIT_DATA: int(statm[5])} if len(statm) > 5 else {}
    limits = {kind: resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)}
    return [
        limit - pages.get(kind, 0) * resource.getpagesize()
        for kind, limit in limits.items()
        if limit != resource.RLIM_INFINITY
    ]


def _left_in_control_groups() -> list[int]:
    """Return the bytes that the limit of each control group of this process, and of the groups around it, leaves."""
    left = []
    for line in _text(_OWN_GROUPS).splitlines():
        _, controllers, group = (line + "::").split(":")[:3]
        if controllers and "memory" not in controllers.split(","):
            continue
        root = _CGROUP / "memory" if controllers else _CGROUP
        limit, used = (
            ("memory.limit_in_bytes", "memory.usage_in_bytes") if controllers else ("memory.max", "memory.current")
        )
        path = PurePosixPath(group)
        # Inside of a container the path may be that of the host, where only the root of the groups can be seen.
        for folder in {root.joinpath(*parent.parts[1:]) for parent in (path, *path.parents)}:
            with contextlib.suppress(ValueError):  # No such group, or "max": no limit.
                left.append(
                    int(_text(folder / limit)) - int(_text(folder / used)) + _reclaimable(folder / "memory.stat")
                )
    return left


def _reclaimable(file: Path) -> int:
    """Return the bytes of files that a control group caches and gives back when memory is needed."""
    found = (
        line.split() for line in _text(file).splitlines() if line.startswith(("inactive_file ", "total_inactive_file "))
    )
    return max((int(words[1]) for words in found), default=0)


def _text(file: Path | str) -> str:
    """Return the text of a file of the system, empty if it does not exist."""
    try:
        return Path(file).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _kibibytes(file: str, name: str) -> int | None:
    """Return the bytes of the entry ``name: 123 kB`` in a file of /proc."""
    found = (line.split() for line in _text(file).splitlines() if line.startswith(name + ":"))
    return next((1024 * int(words[1]) for words in found), None)


def total_memory() -> int | None:
    """Return the bytes of memory that this machine has, None where the system does not report them."""
    if sys.platform == "win32":
        status = _status_of_windows()
        return None if status is None else int(status.total)
    if "SC_PHYS_PAGES" not in os.sysconf_names:
        return None
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _free_on_windows() -> int | None:
    status = _status_of_windows()
    return None if status is None else int(status.available)


def _status_of_windows() -> Any:
    """Return the answer of Windows about its memory, None when there is none."""

    class Status(ctypes.Structure):
        _fields_ = [("size", ctypes.c_ulong), ("load", ctypes.c_ulong)] + [
            (name, ctypes.c_ulonglong)
            for name in ("total", "available", "page_total", "page_free", "virtual_total", "virtual_free", "extended")
        ]

    status = Status()
    status.size = ctypes.sizeof(Status)
    if not ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status)):  # type: ignore[attr-defined, unused-ignore]
        return None
    return status


def _free_on_mac() -> int | None:
    try:
        text = run_text(["vm_stat"], timeout=10).stdout
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
    """Return the peak memory of this process in bytes (on Linux since the last reset), None when not known."""
    if sys.platform == "win32":
        return _peak_on_windows()
    if sys.platform.startswith("linux"):
        # Unlike ru_maxrss, VmHWM can be reset.
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
    """Peak memory of a block of code, set at its end; None where the system cannot measure it."""

    bytes: int | None = None

    @classmethod
    @contextlib.contextmanager
    def of(cls) -> Iterator[PeakMemory]:
        """Measure the peak of the block.

        Notes
        -----
        Linux resets the peak (``clear_refs``). Elsewhere it never falls: when the block did not raise it, the peak of
        the block is unknown, and `bytes` stays None.
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
