"""Processes: started apart from this one, recognised again, ended with all that they started.

A number of a process says little: the system gives it to another program later, and a stored one may be another
computer's. Before a process gets a signal it is recognised: on Windows by the time at which it started, on Linux by its
command and folder, elsewhere by its command.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

_PROC = Path("/proc")
_MAX_LIST_SECONDS = 10.0


def own_group() -> dict[str, Any]:
    """Return arguments of `subprocess.Popen` for a child that gets no signal of this process's terminal.

    It leads a group of processes of its own. On Windows it has no window.
    """
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
    return {"start_new_session": True}


def no_window() -> dict[str, Any]:
    """Return arguments of `subprocess.run` for a program that must not flash a console over Blender on Windows."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NO_WINDOW}
    return {}


def start_time(pid: int) -> int | None:
    """Return when a running process started, in a unit of the system, where this is what `process_runs` compares.

    Returns
    -------
    int or None
        None where processes are recognised by something else, or when there is no such process.
    """
    if sys.platform == "win32":
        with _opened_process(pid, _QUERY) as handle:
            return _started(handle) if handle else None
    return None


def process_runs(pid: int, command: Sequence[str], folder: Path, started: int | None) -> bool | None:
    """Return whether process `pid` is ours and runs `command` in `folder`; None when the system does not tell.

    Parameters
    ----------
    folder : Path
        Working directory of the process, compared where the system tells it (Linux).
    started : int or None
        As `start_time` returned it for this process.
    """
    if sys.platform == "win32":
        with _opened_process(pid, _QUERY) as handle:
            return bool(handle) and started is not None and _started(handle) == started
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, PermissionError, OverflowError):  # not there, another user's, or no number of a process
        return False
    if is_cheap_to_recognise():
        return _runs_in_proc(_PROC / str(pid), command, folder)
    return _listed(["ps", "-ww", "-o", "stat=,args=", "-p", str(pid)], " ".join(command[1:]) or command[0])


def is_cheap_to_recognise() -> bool:
    """Return whether `process_runs` starts no process, so that a window may call it several times a second."""
    return sys.platform == "win32" or (_PROC / str(os.getpid()) / "cmdline").exists()


def kill_group(process: subprocess.Popen[bytes]) -> None:
    """Kill a child that was started with `own_group`, and what it started.

    On Windows the latter needs `end_children_with_this_process` in the child.
    """
    if sys.platform == "win32":
        process.kill()
        return
    # macOS reports a group whose only process has ended with PermissionError.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


def kill_recognised(pid: int, command: Sequence[str], folder: Path, started: int | None) -> bool | None:
    """Kill a process with what it started, if it is the one that `process_runs` recognises.

    Returns
    -------
    bool or None
        False when it is another one or has ended; None, and nothing is killed, when the system does not tell.
    """
    if sys.platform == "win32":
        with _opened_process(pid, _QUERY | _TERMINATE) as handle:
            # The handle keeps the number from being given to another process meanwhile.
            found = bool(handle) and started is not None and _started(handle) == started
            if found:
                _KERNEL.TerminateProcess(handle, 1)
            return found
    found = process_runs(pid, command, folder, started)
    # A job leads its group of processes. One that does not was started in another way.
    if found:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if os.getpgid(pid) == pid:
                os.killpg(pid, signal.SIGKILL)
    return found


def end_children_with_this_process() -> None:
    """Let Windows end all processes that this one starts from now on when this one ends, in whatever way.

    Elsewhere the group of a job is killed as a whole, and children end with `end_with_parent`.
    """
    if sys.platform == "win32":
        _enter_job_that_ends_with_us()


def end_with_parent(pipe: IO[bytes]) -> None:
    """Let this process end when the process that started it dies.

    Parameters
    ----------
    pipe : binary file
        Reading end of a pipe that the parent holds open and does not write to. It is read in a thread.
    """
    if sys.platform == "linux":
        # The thread does the same on other systems, but not while a library holds the interpreter lock.
        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL, 0, 0, 0)
    threading.Thread(target=_exit_at_end, args=(pipe,), daemon=True).start()


def lower_priority(niceness: int) -> None:
    """Let other processes go first on a busy computer, on POSIX by `niceness`."""
    if sys.platform == "win32":
        below_normal = 0x4000
        _KERNEL.SetPriorityClass(_KERNEL.GetCurrentProcess(), below_normal)
    else:
        os.nice(niceness)


def _exit_at_end(stream: IO[bytes]) -> None:
    """End this process when the pipe from the parent closes, because the parent died."""
    stream.read()
    os._exit(1)


def _runs_in_proc(process: Path, command: Sequence[str], folder: Path) -> bool:
    try:
        words = (process / "cmdline").read_bytes().split(b"\0")[:-1]
        directory = (process / "cwd").resolve(strict=True)
        expected = [os.fsencode(word) for word in command]
        # A script is started by its interpreter, and an interpreter may be named by another path.
        same = words[-len(expected) :] == expected or (len(expected) > 1 and words[1:] == expected[1:])
        return same and directory == folder.resolve()
    except (OSError, ValueError):  # it ended meanwhile, or is a zombie
        return False


def _listed(listing: list[str], expected: str) -> bool | None:
    try:
        done = subprocess.run(
            listing, capture_output=True, encoding="utf-8", errors="replace", check=False, timeout=_MAX_LIST_SECONDS
        )
    # Small containers have no `ps`.
    except (OSError, subprocess.TimeoutExpired):
        return None
    return expected in done.stdout and not done.stdout.lstrip().startswith("Z")


if sys.platform == "win32":
    from collections.abc import Iterator
    from ctypes import wintypes

    _QUERY, _TERMINATE, _STILL_ACTIVE = 0x1000, 0x0001, 259
    _KERNEL = ctypes.WinDLL("kernel32", use_last_error=True)
    for _name in ("OpenProcess", "GetCurrentProcess", "CreateJobObjectW"):
        getattr(_KERNEL, _name).restype = wintypes.HANDLE
    _KERNEL.OpenProcess.argtypes = (wintypes.DWORD, wintypes.BOOL, wintypes.DWORD)
    _KERNEL.CloseHandle.argtypes = (wintypes.HANDLE,)
    _KERNEL.GetExitCodeProcess.argtypes = (wintypes.HANDLE, ctypes.POINTER(wintypes.DWORD))
    _KERNEL.GetProcessTimes.argtypes = (wintypes.HANDLE, *[ctypes.POINTER(wintypes.FILETIME)] * 4)
    _KERNEL.TerminateProcess.argtypes = (wintypes.HANDLE, wintypes.UINT)
    _KERNEL.SetPriorityClass.argtypes = (wintypes.HANDLE, wintypes.DWORD)
    _KERNEL.CreateJobObjectW.argtypes = (ctypes.c_void_p, wintypes.LPCWSTR)
    _KERNEL.AssignProcessToJobObject.argtypes = (wintypes.HANDLE, wintypes.HANDLE)
    _KERNEL.SetInformationJobObject.argtypes = (wintypes.HANDLE, ctypes.c_int, ctypes.c_void_p, wintypes.DWORD)
    _job: Any = None

    class _BasicLimits(ctypes.Structure):
        """JOBOBJECT_BASIC_LIMIT_INFORMATION."""

        _fields_ = (
            ("process_time", ctypes.c_int64), ("job_time", ctypes.c_int64), ("flags", wintypes.DWORD),
            ("min_working_set", ctypes.c_size_t), ("max_working_set", ctypes.c_size_t),
            ("n_processes", wintypes.DWORD), ("affinity", ctypes.c_size_t), ("priority", wintypes.DWORD),
            ("scheduling", wintypes.DWORD),
        )  # fmt: skip

    class _ExtendedLimits(ctypes.Structure):
        """JOBOBJECT_EXTENDED_LIMIT_INFORMATION."""

        _fields_ = (
            ("basic", _BasicLimits), ("counters", ctypes.c_uint64 * 6), ("process_memory", ctypes.c_size_t),
            ("job_memory", ctypes.c_size_t), ("peak_process_memory", ctypes.c_size_t),
            ("peak_job_memory", ctypes.c_size_t),
        )  # fmt: skip

    @contextlib.contextmanager
    def _opened_process(pid: int, access: int) -> Iterator[Any]:
        """Yield a handle of a process that runs now, None when there is none or it is another user's."""
        handle = _KERNEL.OpenProcess(access, False, pid) if 0 < pid < 1 << 32 else None
        try:
            code = wintypes.DWORD()
            runs = handle and _KERNEL.GetExitCodeProcess(handle, code) and code.value == _STILL_ACTIVE
            yield handle if runs else None
        finally:
            if handle:
                _KERNEL.CloseHandle(handle)

    def _started(handle: Any) -> int | None:
        """Return when a process started, in units of 100 ns since 1601."""
        times = [wintypes.FILETIME() for _ in range(4)]
        if not _KERNEL.GetProcessTimes(handle, *times):
            return None
        return (times[0].dwHighDateTime << 32) + times[0].dwLowDateTime

    def _enter_job_that_ends_with_us() -> None:
        """Make a job object that ends its processes when its last handle closes, which is ours, and enter it."""
        global _job
        extended_limit_information, kill_on_close = 9, 0x2000
        if _job is not None:
            return
        job = _KERNEL.CreateJobObjectW(None, None)
        limits = _ExtendedLimits()
        limits.basic.flags = kill_on_close
        if (
            not job
            or not _KERNEL.SetInformationJobObject(
                job, extended_limit_information, ctypes.byref(limits), ctypes.sizeof(limits)
            )
            or not _KERNEL.AssignProcessToJobObject(job, _KERNEL.GetCurrentProcess())
        ):
            raise ctypes.WinError(ctypes.get_last_error())
        _job = job
