"""Errors as sentences for the user. The traceback of an unexpected error goes to a log file. Does not import bpy."""

from __future__ import annotations

import contextlib
import logging
import traceback
from collections.abc import Callable
from logging.handlers import RotatingFileHandler
from pathlib import Path

from ...engine.core.errors import HeritageError, is_out_of_memory
from ...engine.core.visible_text import visible

_LOG = logging.getLogger(__name__)
_LOG_FILE = "errors.log"
_MAX_LOG_BYTES = 1 << 20
_MAX_UNEXPECTED = 200
"""Characters of an unexpected error that are shown. The log file has all of them."""
_MAX_REMEMBERED = 1000
_ADVICE_MEMORY = "Close other programs, or work with a smaller scene, and try again."

_log_folder: Callable[[], Path] | None = None
_logged: set[str] = set()
"""Unexpected errors that are in the log file. A panel that fails is drawn again and again, but logged once."""
_shown = ""


def set_log_folder(find: Callable[[], Path] | None) -> None:
    """Set the function that returns the folder of the log file. It is called when the first error is logged."""
    global _log_folder
    _log_folder = find


def show(sentence: str) -> None:
    """Show `sentence` in the panel: for errors in timers and callbacks, which cannot report."""
    global _shown
    _shown = sentence


def shown() -> str:
    """Return the sentence of the last error in a timer or callback; empty when there is none."""
    return _shown


def clear() -> None:
    """Remove the sentence from the panel."""
    show("")


def plain_text(text: str) -> str:
    """Return `text` as one line that Blender can show."""
    return visible(" ".join(text.split()))


def sentence_of(error: Exception) -> str:
    """Return the sentence for the user about `error`.

    The message of a `HeritageError` is such a sentence. Any other error is a mistake in this program or a full memory:
    it is logged with its traceback, and the sentence names the log file.
    """
    if isinstance(error, HeritageError):
        return plain_text(str(error))
    reason = plain_text(f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)
    if len(reason) > _MAX_UNEXPECTED:
        reason = f"{reason[: _MAX_UNEXPECTED - 3]}..."
    file = _log(error)
    details = f"details are in {plain_text(str(file))}" if file else "details could not be saved"
    if is_out_of_memory(error):
        return f"There is not enough memory ({reason}); {details}. {_ADVICE_MEMORY}"
    return f"An unexpected error occurred: {reason}; {details}. Please report it."


def _log(error: Exception) -> Path | None:
    """Append the traceback of `error` to the log file, once, and return the file; None when it cannot be written."""
    # Whatever fails here must not hide the error that is reported.
    with contextlib.suppress(Exception):
        if _log_folder is None:
            return None
        file = _log_folder() / _LOG_FILE
        lines = traceback.format_exception(error)
        key = "".join(lines)
        if key in _logged:
            return file
        if len(_logged) >= _MAX_REMEMBERED:
            _logged.clear()
        _logged.add(key)
        handler = RotatingFileHandler(
            file, maxBytes=_MAX_LOG_BYTES, backupCount=1, encoding="utf-8", errors="backslashreplace"
        )
        try:
            handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
            record = _LOG.makeRecord(_LOG.name, logging.ERROR, __file__, 0, "%s", ("".join(lines),), None)
            handler.emit(record)
        finally:
            handler.close()
        return file
    return None
