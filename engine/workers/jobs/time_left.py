"""The time left for a whole reconstruction, from the forecast that the engine stored in the project."""

from __future__ import annotations

import math
from pathlib import Path

from ...core.errors import HeritageError
from ...core.files import read_after_change
from ...project.folder import PROJECT_FILE, ProjectFolder
from .job import JobState


def seconds_left_in_all(project: Path, state: JobState) -> float | None:
    """Return the seconds that a running reconstruction of `project` still takes; None when there is no forecast.

    The stage at work states its own time; where it does not, and for the stages to come, the forecast counts.
    """
    forecast = dict(_forecast(project))
    if state.stage not in forecast:
        return None
    expected = list(forecast.values())[list(forecast).index(state.stage) :]
    now = state.seconds_left if state.seconds_left is not None else expected[0] * (1.0 - state.fraction)
    return now + sum(expected[1:])


@read_after_change(PROJECT_FILE)
def _forecast(project: Path) -> tuple[tuple[str, float], ...]:
    """Return the forecast seconds of each stage, in order; nothing when they cannot be read."""
    try:
        forecast = ProjectFolder.open_existing(project).get("forecast")
        stages = [(str(stage["stage"]), float(stage["seconds"])) for stage in forecast["stages"]]
    except (HeritageError, KeyError, TypeError, ValueError):
        return ()
    return tuple(stages) if all(math.isfinite(seconds) and seconds >= 0 for _, seconds in stages) else ()
