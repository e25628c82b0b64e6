"""Long pycolmap calls with progress and Cancel, and without COLMAP's own chatter."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import TypeVar

import pycolmap

from ..errors import CameraError, Cancelled, DiskError
from ..events import StopCheck

__all__ = ["threads_for_colmap", "wait_for"]

_LOG = logging.getLogger(__name__)
_POLL_SECONDS = 0.2

# COLMAP writes to stderr, past Python's logging. What matters comes back as an exception, in our words.
pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)

Result = TypeVar("Result")


def threads_for_colmap(threads: int) -> int:
    """Return COLMAP's number for `threads`: -1 (all cores) for 0."""
    return threads if threads > 0 else -1


def wait_for(
    what: str,
    call: Callable[[pycolmap.CancellationToken], Result],
    *,
    report: Callable[[], None],
    should_stop: StopCheck,
) -> Result:
    """Return what `call` returns, while this thread reports progress and asks `should_stop` five times a second.

    Parameters
    ----------
    what : str
        The work in a few words, for messages: "matching the photos".
    call : callable
        Runs in another thread (pycolmap lets go of the interpreter) and hands the token on to pycolmap.
    report : callable
        Called in this thread.
    should_stop : StopCheck
        Called in this thread.

    Raises
    ------
    Cancelled
        When `should_stop` said so; pycolmap has then ended.
    CameraError
        When pycolmap fails.
    DiskError
        When it fails for want of space.
    """
    token = pycolmap.CancellationToken()
    results: list[Result] = []
    failures: list[Exception] = []

    def work() -> None:
        try:
            results.append(call(token))
        except Exception as error:  # noqa: BLE001 handed on to the waiting thread below
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
        # An error in `report` must not leave COLMAP writing into the folder.
        token.cancel()
        thread.join()
    if stopped:
        raise Cancelled(f"Stopped while {what}. The next run continues from here.")
    if failures:
        _raise_in_our_words(what, failures[0])
    return results[0]


def _raise_in_our_words(what: str, error: Exception) -> None:
    if not isinstance(error, RuntimeError | ValueError | IndexError | OSError):
        raise error
    text = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    _LOG.error("pycolmap failed while %s: %s", what, error)
    if "disk is full" in text or "No space left" in text or "disk I/O" in text:
        raise DiskError(
            f"The disk is full or unreachable: it failed while {what}. Free some space and run again."
        ) from error
    raise CameraError(f"COLMAP failed while {what}: {text}") from error
