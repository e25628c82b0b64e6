r"""Two gaps of Wine: the limit of 260 characters of a path, and the error of a file that another process has locked.

`msvcrt.locking` fails with the error 0 under Wine, and with EACCES on Windows.

It lies in the library of Windows' Python, so every process has the limit, also below a virtual environment and with
the option ``-I``. Environment variable WINTEST_MAX_PATH: the longest path with the zero at its end (260 on Windows,
unless long paths were enabled), 0 or missing for no limit. As on Windows, paths that begin with ``\\?\`` are not
limited, and a folder needs 12 characters more. Native code of packages is not limited.
"""

import errno
import msvcrt
import os
import sys

_EVENTS = {
    "open", "os.listdir", "os.scandir", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.truncate", "os.utime",
    "os.link", "os.symlink", "os.chdir", "os.chmod",
}  # fmt: skip
_PLACES = 2
"""Arguments of an event that can be paths: os.rename, os.link and os.symlink have two."""
_LOOKING = ("stat", "lstat", "readlink", "access")
_ROOM_OF_A_FOLDER = 12
_NOT_FOUND, _TOO_LONG = 3, 206


def _install(max_path: int) -> None:
    full_path = __import__("nt")._getfullpathname

    def check(path: object, room: int = 0) -> None:
        try:
            text = os.fsdecode(path)  # type: ignore[arg-type]
        except TypeError:  # a number of an open file, or none
            return
        if not text or text.startswith(("\\\\?\\", "\\\\.\\")):
            return
        try:
            length = len(full_path(text)) + 1
        except (OSError, ValueError):
            return
        if length + room > max_path:
            code = _TOO_LONG if room else _NOT_FOUND
            raise OSError(2, "The path is too long (simulated limit of Windows)", text, code)

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event not in _EVENTS:
            return
        if event == "open" and not isinstance(arguments[0], (str, bytes)):
            return
        for argument in arguments[: _PLACES if event in ("os.rename", "os.link", "os.symlink") else 1]:
            check(argument, _ROOM_OF_A_FOLDER if event == "os.mkdir" else 0)

    sys.addaudithook(hook)
    # These raise no event of an audit.
    for name in _LOOKING:
        own = getattr(os, name)

        def limited(path: object, *arguments: object, _own: object = own, **options: object) -> object:
            check(path)
            return _own(path, *arguments, **options)  # type: ignore[operator]

        limited.__name__ = name
        setattr(os, name, limited)
        os.supports_fd.add(limited) if own in os.supports_fd else None
        os.supports_follow_symlinks.add(limited) if own in os.supports_follow_symlinks else None


_lock = msvcrt.locking  # type: ignore[attr-defined]


def _locking(file: int, mode: int, n_bytes: int) -> None:
    try:
        _lock(file, mode, n_bytes)
    except OSError as error:
        if error.errno:
            raise
        raise PermissionError(errno.EACCES, "Permission denied") from error


msvcrt.locking = _locking  # type: ignore[attr-defined]

if _max_path := int(os.environ.get("WINTEST_MAX_PATH") or 0):
    _install(_max_path)
