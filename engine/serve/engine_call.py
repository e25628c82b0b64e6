"""Short work of the engine that a request waits for: exports, the report, forecasts."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from ..core.errors import HeritageError, ProjectError
from ..core.events import ErrorEvent, Finished, from_json_line
from ..core.system import CODE_ROOT

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
    # -P: a file in the current folder must not pass for a module of ours.
    command = [sys.executable, "-P", "-m", "engine", *arguments, "--events"]
    environment = {**os.environ, "PYTHONPATH": str(CODE_ROOT), "PYTHONSAFEPATH": "1"}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, env=environment, timeout=_MAX_SECONDS, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise ProjectError(f"The {what} took more than {_MAX_SECONDS} seconds. Make it in Blender.") from error
    events = [from_json_line(line) for line in done.stdout.splitlines()]
    if done.returncode:
        sentences = [event.message for event in events if isinstance(event, ErrorEvent)]
        raise HeritageError(sentences[-1] if sentences else f"The {what} failed. The server's log has the details.")
    finished = [event.outputs for event in events if isinstance(event, Finished)]
    return finished[-1] if finished else {}
