"""Short work of the engine that a request waits for: exports, the report, forecasts, answers."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

from ..core.errors import HeritageError, ProjectError, PromptError
from ..core.events import ignore_events
from ..workers.jobs import EngineRun

_LOG = logging.getLogger(__name__)
_MAX_SECONDS = 600
_KINDS: dict[str, type[HeritageError]] = {kind.__name__: kind for kind in (ProjectError, PromptError)}
"""Refusals of the engine, not faults of the server, by their names in its events."""


def call_engine(arguments: Sequence[str], what: str, *, advice: str = "Make it in Blender.") -> dict[str, Any]:
    """Run ``python -m engine`` with `arguments` and return its results, see `engine.core.events.Finished`.

    Parameters
    ----------
    what : str
        What is done, for the messages: "export".
    advice : str
        What to do where it takes too long.

    Raises
    ------
    HeritageError
        With the engine's own sentence; a `PromptError` or `ProjectError` is one here, too.
    ProjectError
        When it takes too long; it is killed then.
    """
    run = EngineRun(arguments, ignore_events)
    code = run.wait(_MAX_SECONDS)
    if run.late:
        raise ProjectError(f"The {what} took more than {_MAX_SECONDS} seconds. {advice}")
    if code:
        _LOG.error("The %s failed with exit code %d: %s", what, code, run.process.complaints())
        kind = _KINDS.get(run.state.error_type, HeritageError)
        raise kind(run.state.error or f"The {what} failed. The server's log has the details.")
    return run.state.outputs
