"""Times of files, and names in the order of time: clocks are coarse, and go back."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import time
from collections.abc import Iterable
from pathlib import Path

_DIGITS = 20
_lock = threading.Lock()
_last = 0


def change_time_ns(path: Path, status: os.stat_result) -> int:
    """Return when the content or the attributes of a file last changed, in nanoseconds; programs cannot set it back.

    Parameters
    ----------
    status : os.stat_result
        Of `path`. Its ``st_ctime_ns`` is the time of creation on Windows, which a change of the content leaves.

    Raises
    ------
    OSError
        When the system does not tell it.
    """
    if sys.platform == "win32":
        return _change_time_on_windows(path)
    return status.st_ctime_ns


def name_in_order(existing: Iterable[str]) -> str:
    """Return a name for a new file that sorts behind all `existing` ones and that no other process chooses.

    Parameters
    ----------
    existing : iterable of str
        Names that this function gave, with or without a suffix; others are ignored.
    """
    global _last
    numbers = (name[:_DIGITS] for name in existing)
    newest = max((int(number) for number in numbers if number.isdecimal()), default=0)
    with _lock:
        _last = max(time.time_ns(), _last + 1, newest + 1)
        return f"{_last:0{_DIGITS}d}-{os.getpid()}"


if sys.platform == "win32":

    class _BasicInfo(ctypes.Structure):
        """FILE_BASIC_INFO."""

        _fields_ = [(name, ctypes.c_longlong) for name in ("created", "accessed", "written", "changed")] + [
            ("attributes", ctypes.c_ulong)
        ]

    def _change_time_on_windows(path: Path) -> int:
        import msvcrt

        since_1601 = 116_444_736_000_000_000
        info, file_basic_info = _BasicInfo(), 0
        with path.open("rb") as stream:
            handle = ctypes.c_void_p(msvcrt.get_osfhandle(stream.fileno()))
            found = ctypes.WinDLL("kernel32", use_last_error=True).GetFileInformationByHandleEx(
                handle, file_basic_info, ctypes.byref(info), ctypes.sizeof(info)
            )
        if not found:
            raise ctypes.WinError(ctypes.get_last_error())
        return (info.changed - since_1601) * 100
