"""The time left for a whole reconstruction, from the forecast that the engine stored in the project."""

from __future__ import annotations

import functools
import math
from pathlib import Path

from ...core.errors import HeritageError
from ...project.folder import PROJECT_FILE, ProjectFolder
from .job import JobState

__all__ = ["seconds_left_in_all"]


def seconds_left_in_all(project: Path, state: JobState) -> float | None:
    """Return the seconds that a running reconstruction of `project` still takes; None when there is no forecast.

    The stage at work states its own time; where it does not, and for the stages to come, the forecast counts.
    """
    try:
        changed = (project / PROJECT_FILE).stat().st_mtime_ns
    except (OSError, ValueError):  # ValueError: a null character in the path
        return None
    forecast = dict(_read(project, changed))
    if state.stage not in forecast:
        return None
    expected = list(forecast.values())[list(forecast).index(state.stage) :]
    now = state.seconds_left if state.seconds_left is not None else expected[0] * (1.0 - state.fraction)
    return now + sum(expected[1:])


# Cached, because Blender's panel calls this at each redraw, and the server for each event.
@functools.lru_cache(maxsize=4)
def _read(project: Path, changed: int) -> tuple[tuple[str, float], ...]:
    """Return the forecast seconds of each stage, in order; nothing when they cannot be read."""
    try:
        forecast = ProjectFolder.open_existing(project).get("forecast")
        stages = [(str(stage["stage"]), float(stage["seconds"])) for stage in forecast["stages"]]
    except (HeritageError, KeyError, TypeError, ValueError):
        return ()
    return tuple(stages) if all(math.isfinite(seconds) and seconds >= 0 for _, seconds in stages) else ()
