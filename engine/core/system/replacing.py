"""Replacing and deleting files that another program may be reading, and why a disk refused.

On Windows a file that a viewer, a virus scanner or a sync program has open can be neither replaced nor deleted. Most
let go after a moment, so each step is tried again for some seconds.
"""

from __future__ import annotations

import errno
import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

_PAUSES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.0, 1.0)
"""Seconds between two trials."""
_ACCESS_DENIED, _SHARING_VIOLATION, _LOCK_VIOLATION, _PATH_TOO_LONG, _DISK_FULL = 5, 32, 33, 206, 112
"""Numbers of Windows' errors."""
_MAX_WINDOWS_PATH = 259
_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
_NOT_ALLOWED = (errno.EACCES, errno.EPERM, errno.EROFS)


def replace_file(source: Path, target: Path) -> None:
    """Move `source` to `target`, which is replaced, as `os.replace`; wait for a program that has one of them open.

    Raises
    ------
    OSError
        When it cannot be done, after some seconds where another program uses a file.
    """
    _patiently(lambda: os.replace(source, target))


def delete_file(path: Path) -> None:
    """Delete a file if it exists; wait for a program that has it open, and raise `OSError` when it does not let go."""
    _patiently(lambda: path.unlink(missing_ok=True))


def delete_tree(folder: Path) -> None:
    """Delete a folder with all that it holds; waits and raises as `delete_file`."""
    _patiently(lambda: shutil.rmtree(folder))


def advice_for(error: OSError, path: Path) -> str:
    """Return what the user should do about a file that could not be written, replaced or deleted, as a sentence."""
    code = getattr(error, "winerror", None)
    if error.errno in _FULL or code == _DISK_FULL:
        return "Free some space or choose another folder."
    if code in (_SHARING_VIOLATION, _LOCK_VIOLATION):
        return "Another program has it open: close it (a viewer, Explorer's preview, a sync program), then run again."
    if code == _PATH_TOO_LONG or (_limits_paths() and len(str(path)) > _MAX_WINDOWS_PATH):
        return (
            f"Its path has {len(str(path))} characters, more than Windows allows. Choose a folder with a shorter path."
        )
    if error.errno in _NOT_ALLOWED and _limits_paths():
        return "Close programs that have it open (a viewer, a sync program), or choose a folder that you may write to."
    if error.errno in _NOT_ALLOWED:
        return "You may not write there, or the disk is read-only. Choose another folder."
    return "Free some space or choose another folder."


def _limits_paths() -> bool:
    return sys.platform == "win32"


def _patiently(action: Callable[[], None]) -> None:
    for pause in _PAUSES:
        try:
            return action()
        except OSError as error:
            if not _is_held(error):
                raise
        time.sleep(pause)
    action()


def _is_held(error: OSError) -> bool:
    """Return whether another program may hold the file; Windows says "access denied" for that too."""
    return getattr(error, "winerror", None) in (_ACCESS_DENIED, _SHARING_VIOLATION, _LOCK_VIOLATION)
