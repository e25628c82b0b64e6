"""pycolmap calls with progress, cancellation and errors of ours, and without COLMAP's log messages."""

from __future__ import annotations

import contextlib
import logging
import shutil
import sqlite3
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn, TypeVar

from ..core.errors import CameraError, Cancelled, DiskError
from ..core.events import StopCheck
from ..core.files import delete_derived
from .colmap import pycolmap

_LOG = logging.getLogger(__name__)
_POLL_SECONDS = 0.2
_MIN_FREE_BYTES = 64_000_000
"""More than COLMAP writes in one call: 8 MB with the default settings, features of 4 photos and SQLite's journal."""

# COLMAP logs to stderr, not to Python's logging. Its failures arrive as exceptions, which this module translates.
pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)

Result = TypeVar("Result")

_DISK_MESSAGES = (
    "disk is full",
    "No space left",
    "disk I/O",
    "readonly database",
    "unable to open database",
    # All that pycolmap says when SQLite cannot open or create the file.
    "No registered database factory",
    "Could not open",
)


@contextlib.contextmanager
def translated(what: str) -> Iterator[None]:
    """Turn exceptions of pycolmap in this block into errors of ours; for `what` and the errors see `wait_for`."""
    try:
        yield
    except Exception as error:  # noqa: BLE001 those that are not pycolmap's are raised again
        _raise_translated(what, error)


@contextlib.contextmanager
def opened_database(path: Path) -> Iterator[pycolmap.Database]:
    """Open a COLMAP database, which is created when missing, and close it at the end; raises as `translated` does."""
    with translated(f"using {path}"), pycolmap.Database.open(path) as database:
        yield database


def create_database(path: Path) -> None:
    """Create a COLMAP database, instead of what an ended run left under its name.

    Raises
    ------
    CameraError, DiskError
        When it cannot be written.
    """
    for leftover in path.parent.glob(path.name + "*"):
        delete_derived(leftover.parent, leftover.name)
    require_free_space(path.parent)
    with opened_database(path):
        pass


def verified_pairs(database: pycolmap.Database, at_least: int) -> list[tuple[int, int, int]]:
    """Return the pairs with at least so many verified matches as (first image id, second, matches), sorted."""
    pairs = zip(*database.read_two_view_geometry_num_inliers(), strict=True)
    return sorted((*pycolmap.pair_id_to_image_pair(pair_id), count) for pair_id, count in pairs if count >= at_least)


def lens_of(model: pycolmap.Reconstruction, image_id: int) -> pycolmap.Camera:
    """Return the lens of a photo, which keeps its model alive, as ``image.camera`` does not."""
    return model.camera(model.image(image_id).camera_id)


def require_free_space(folder: Path) -> None:
    """Raise `DiskError` when the disk of `folder` is nearly full.

    COLMAP ends this whole process when the disk is full while it stores features or matches.
    """
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise DiskError(f"{folder} cannot be used: {error.strerror}. Check the disk, then run again.") from error
    if free < _MIN_FREE_BYTES:
        raise DiskError(
            f"The disk of {folder} is nearly full: {free / 1e6:.0f} MB are free, and the search for camera poses needs "
            f"{_MIN_FREE_BYTES / 1e6:.0f} MB at a time. Free some space and run again."
        )


def is_whole_database(path: Path) -> bool:
    """Return whether a COLMAP database is missing or can be read; what a damaged one holds is computed again."""
    if not path.is_file():
        return True
    try:
        with contextlib.closing(sqlite3.connect(path)) as database:
            return list(database.execute("PRAGMA quick_check(1)")) == [("ok",)]
    except (sqlite3.DatabaseError, UnicodeDecodeError):
        return False


def wait_for(
    what: str,
    call: Callable[[pycolmap.CancellationToken], Result],
    *,
    report: Callable[[], None] = lambda: None,
    should_stop: StopCheck,
) -> Result:
    """Return the result of `call`, which runs in another thread; this thread reports progress and checks for a stop.

    Parameters
    ----------
    what : str
        Description of the work for messages, e.g. "matching the photos".
    call : callable
        Called in another thread (pycolmap releases the interpreter lock). It must pass the token to pycolmap.
    report, should_stop : callable
        Called in this thread five times a second.

    Raises
    ------
    Cancelled
        When `should_stop` returned True, after pycolmap has ended.
    CameraError
        When pycolmap fails.
    DiskError
        When pycolmap fails because the disk is full or unreachable.
    """
    token = pycolmap.CancellationToken()
    results: list[Result] = []
    failures: list[Exception] = []

    def work() -> None:
        try:
            results.append(call(token))
        except Exception as error:  # noqa: BLE001 raised in the waiting thread below
            failures.append(error)

    thread = threading.Thread(target=work, name=f"pycolmap: {what}", daemon=True)
    thread.start()
    stopped = False
    try:
        while thread.is_alive():
            thread.join(_POLL_SECONDS)
            report()
            if not stopped and should_stop():
                stopped = True
                token.cancel()
    finally:
        # After an error in `report`, COLMAP must not continue to write to the folder.
        token.cancel()
        thread.join()
    if stopped:
        raise Cancelled(f"Stopped while {what}. The next run continues from here.")
    if failures:
        _raise_translated(what, failures[0])
    return results[0]


def _raise_translated(what: str, error: Exception) -> NoReturn:
    if not isinstance(error, RuntimeError | ValueError | IndexError | OSError):
        raise error
    text = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    _LOG.error("pycolmap failed while %s: %s", what, error)
    if any(message in str(error) for message in _DISK_MESSAGES):
        raise DiskError(
            f"The disk is full, read-only or unreachable while {what}. Free some space and run again."
        ) from error
    raise CameraError(f"COLMAP failed while {what}: {text}") from error
