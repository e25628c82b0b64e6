"""Long pycolmap calls with progress and cancellation, and without COLMAP's log messages."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import TypeVar

from ..errors import CameraError, Cancelled, DiskError
from ..events import StopCheck
from .colmap import pycolmap

__all__ = ["threads_for_colmap", "wait_for"]

_LOG = logging.getLogger(__name__)
_POLL_SECONDS = 0.2

# COLMAP logs to stderr, not to Python's logging. Its failures arrive as exceptions, which this module translates.
pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)

Result = TypeVar("Result")


def threads_for_colmap(threads: int) -> int:
    """Return the number of threads as COLMAP expects it: -1 instead of 0 for all cores."""
    return threads if threads > 0 else -1


def wait_for(
    what: str,
    call: Callable[[pycolmap.CancellationToken], Result],
    *,
    report: Callable[[], None],
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


def _raise_translated(what: str, error: Exception) -> None:
    if not isinstance(error, RuntimeError | ValueError | IndexError | OSError):
        raise error
    text = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    _LOG.error("pycolmap failed while %s: %s", what, error)
    if "disk is full" in text or "No space left" in text or "disk I/O" in text:
        raise DiskError(f"The disk is full or unreachable while {what}. Free some space and run again.") from error
    raise CameraError(f"COLMAP failed while {what}: {text}") from error
