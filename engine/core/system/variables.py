"""Environment variables for libraries of native code, which read them in this process."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def variable_for_libraries(name: str, value: str) -> Iterator[None]:
    """Set an environment variable for native libraries too, until the block ends.

    Raises
    ------
    OSError
        When the system refuses it.
    """
    before = os.environ.get(name)
    _set(name, value)
    try:
        yield
    finally:
        _set(name, before)


def _set(name: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value
    # Python sets it in the present C runtime. The older one has its own copy, and FFmpeg in OpenCV asks that one.
    if sys.platform == "win32" and ctypes.CDLL("msvcrt")._wputenv(f"{name}={value or ''}"):
        raise OSError(f"{name} could not be set")
