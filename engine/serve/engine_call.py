"""Short work of the engine that a request waits for: exports, the report, forecasts."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import IO, Any

from ..core.engine_process import EngineProcess, engine_command, engine_environment, events_in
from ..core.errors import HeritageError, ProjectError
from ..workers.jobs import JobState

__all__ = ["call_engine"]

_LOG = logging.getLogger(__name__)
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
        When it takes too long; it is killed then.
    """
    state = JobState()

    def follow(stream: IO[bytes]) -> None:
        for event in events_in(stream):
            state.update(event)

    with EngineProcess.start(engine_command(*arguments, "--events"), engine_environment(), follow) as process:
        if not process.wait(_MAX_SECONDS):
            raise ProjectError(f"The {what} took more than {_MAX_SECONDS} seconds. Make it in Blender.")
    if process.code:
        _LOG.error("The %s failed with exit code %d: %s", what, process.code, process.complaints())
        raise HeritageError(state.error or f"The {what} failed. The server's log has the details.")
    return state.outputs
