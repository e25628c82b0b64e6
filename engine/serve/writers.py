"""One writer per project: what takes in, renames or removes chooses names from what is there, and must be alone."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from weakref import WeakValueDictionary

_locks: WeakValueDictionary[Path, threading.RLock] = WeakValueDictionary()
_finding = threading.Lock()


@contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Be the only one of this server who changes the names in a project's folder; it is held for moments only.

    Other servers cannot work with the same data (`engine.serve.run`).
    """
    with _finding:
        held = _locks.get(folder)
        if held is None:
            held = _locks[folder] = threading.RLock()
    with held:
        yield
