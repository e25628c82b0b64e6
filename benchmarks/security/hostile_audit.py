"""Records what a Python process writes, moves or deletes outside of some folders. Standard library only.

`watch` is called in a process of ours. In an interpreter that another program starts, the folder of a
``sitecustomize.py`` with ``import hostile_audit`` is put on PYTHONPATH, see `benchmarks.security.hostile_blender`.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

_FIRST = {"os.remove", "os.rmdir", "os.mkdir", "os.chmod", "os.chown", "os.utime", "os.truncate", "shutil.rmtree"}
"""Audit events whose first argument names what is changed."""
_SECOND = {"os.symlink", "os.link", "shutil.copyfile", "shutil.copymode", "shutil.copystat", "shutil.copytree"}
_BOTH = {"os.rename", "shutil.move"}
_FOLLOWED = {"os.chmod", "os.chown", "os.utime", "os.truncate", "shutil.copyfile", "shutil.copymode", "shutil.copystat"}
"""Of these, what a link leads to is changed; of the others, the link itself."""
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


def watch(allowed: Callable[[], Iterable[Path]], found: Callable[[str], None]) -> None:
    """Call `found` with a sentence for each attempt to change something outside of the folders `allowed`.

    Parameters
    ----------
    allowed : callable
        Asked at each event; the folders with all links followed.
    found : callable

    Notes
    -----
    An attempt counts also when it fails. Libraries in C do not go through Python; for them the tree is compared.
    """
    busy = threading.local()

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if getattr(busy, "yes", False) or event not in _EVENTS:
            return
        busy.yes = True
        try:
            for path in _changed(event, arguments):
                if not any(path == folder or path.is_relative_to(folder) for folder in (*allowed(), *_SYSTEM)):
                    found(f"{event} {path}")
        finally:
            busy.yes = False

    sys.addaudithook(hook)


_SYSTEM = tuple(Path(name) for name in ("/dev", "/proc"))
_EVENTS = {"open", *_FIRST, *_SECOND, *_BOTH}


def _changed(event: str, arguments: tuple[Any, ...]) -> list[Path]:
    """Return the paths that an event changes, as they are after following links."""
    if event == "open":
        name, mode, flags = arguments
        writes = any(letter in mode for letter in "wax+") if isinstance(mode, str) else bool(int(flags or 0) & _WRITING)
        return _path(name, None, follow=True) if writes else []
    follow = event in _FOLLOWED
    if event in _FIRST:
        # remove, rmdir, mkdir, chmod: (path, [mode,] dir_fd); a name relative to an open folder.
        folder = arguments[-1] if event in ("os.remove", "os.rmdir", "os.mkdir", "os.chmod") else None
        return _path(arguments[0], folder, follow=follow)
    if event in _SECOND:
        return _path(arguments[1], arguments[2] if event == "os.symlink" else None, follow=follow)
    if event == "os.rename":
        return [*_path(arguments[0], arguments[2], follow=False), *_path(arguments[1], arguments[3], follow=False)]
    return [*_path(arguments[0], None, follow=False), *_path(arguments[1], None, follow=False)]


def _path(name: Any, folder: Any, *, follow: bool) -> list[Path]:
    if isinstance(name, int):
        return []  # an open file, whose opening was seen
    text = os.fsdecode(name)
    if isinstance(folder, int) and folder >= 0 and not os.path.isabs(text):
        text = os.path.join(os.readlink(f"/proc/self/fd/{folder}"), text)
    if "\0" in text:
        return []  # the system refuses it
    head, tail = os.path.split(os.path.abspath(text))
    return [Path(os.path.realpath(text) if follow else os.path.join(os.path.realpath(head), tail))]
