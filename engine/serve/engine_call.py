"""Short work of the engine that a request waits for: exports, the report, forecasts."""

from __future__ import annotations

import io
import subprocess
from collections.abc import Sequence
from typing import Any

from ..core.engine_process import engine_command, engine_environment, events_in
from ..core.errors import HeritageError, ProjectError
from ..core.events import ErrorEvent, Finished

__all__ = ["call_engine"]

_MAX_SECONDS = 600


def call_engine(arguments: Sequence[str], what: str) -> dict[str, Any]:
    """Run ``python -m engine`` with `arguments` and return its results, see `engine.core.events.Finished`.

    Parameters
    ----------
    arguments : sequence of str
    what : str
        What is done, for the messages: "export".

    Raises
    ------
    HeritageError
        With the engine's own sentence.
    ProjectError
        When it takes too long.
    """
    command = engine_command(*arguments, "--events")
    try:
        done = subprocess.run(command, capture_output=True, env=engine_environment(), timeout=_MAX_SECONDS, check=False)
    except subprocess.TimeoutExpired as error:
        raise ProjectError(f"The {what} took more than {_MAX_SECONDS} seconds. Make it in Blender.") from error
    events = list(events_in(io.BytesIO(done.stdout)))
    if done.returncode:
        sentences = [event.message for event in events if isinstance(event, ErrorEvent)]
        raise HeritageError(sentences[-1] if sentences else f"The {what} failed. The server's log has the details.")
    finished = [event.outputs for event in events if isinstance(event, Finished)]
    return finished[-1] if finished else {}
