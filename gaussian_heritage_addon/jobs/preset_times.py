"""How long each preset takes for a folder of photos. The engine is asked, beside the jobs that the user started."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy

from ...engine.core.errors import HeritageError
from ...engine.workers.jobs import Job
from ..blender.guards import Timer, add_load_handler, on_unregister, redraw
from ..blender.open_dialog import forget_dialog, redraw_dialog
from ..setup.engine_process import engine_command
from ..setup.preferences import current_environment, current_python, user_folder

_INTERVAL = 0.5
"""Seconds between two polls, and before a folder is asked about: a file browser passes through many folders."""
_MAX_KNOWN = 32
"""Folders whose times are kept."""
_AGAIN = ("training", "objects", "report")
"""Stages that another preset does again on the same photos."""

_wanted: Path | None = None
_job: Job | None = None
_shown = ""
"""What was drawn last of how far the engine is."""
_known: OrderedDict[Path, dict[str, dict[str, float]]] = OrderedDict()
"""Seconds of each stage by preset; empty for a folder that the engine could not say anything of."""


def preset_seconds(photos: Path, *, again: bool = False) -> dict[str, float] | None:
    """Return the forecast seconds of each preset for a folder of photos.

    Parameters
    ----------
    photos : Path
        Folder that `ask` was called with.
    again : bool
        Count only what another preset does again for a project of these photos.

    Returns
    -------
    dict or None
        Empty when the engine cannot say; None when it has not answered yet, or was not asked.
    """
    stages = _known.get(photos)
    if stages is None:
        return None
    return {
        name: sum(seconds for stage, seconds in one.items() if not again or stage in _AGAIN)
        for name, one in stages.items()
    }


def progress() -> str:
    """Return how far the engine is with the wanted folder, such as "12 of 48 photos"; empty while it starts."""
    return _shown if _job is not None and Path(_job.subject) == _wanted else ""


def ask(photos: Path) -> None:
    """Let the engine forecast the presets for a folder, unless its times are known. Only the last folder counts."""
    global _wanted
    if photos == _wanted and (photos in _known or _job is not None):
        return
    _wanted = photos
    if not bpy.app.background:
        _timer.start(_INTERVAL, persistent=True)


def stop() -> None:
    """Ask no more."""
    global _wanted, _job, _shown
    _timer.stop()
    if _job is not None and _job.poll().running:
        _job.cancel()
    _wanted = _job = None
    _shown = ""


def poll() -> float | None:
    """Start the engine for the wanted folder, or take its answer; return the seconds until the next call."""
    global _job, _shown
    if _wanted is None or _wanted in _known:
        return None
    if _job is None:
        _job, _shown = _start(_wanted), ""
        return _INTERVAL if _job is not None else None
    state = _job.poll()
    if state.running:
        if Path(_job.subject) != _wanted:
            _job.cancel()
        elif state.message != _shown:
            _shown = state.message
            redraw()
            redraw_dialog()
        return _INTERVAL
    if state.finished:
        _keep(Path(_job.subject), _stages_of(state.outputs))
    elif Path(_job.subject) == _wanted:
        # What is wrong with the photos is said when they are imported.
        _keep(_wanted, {})
    _job = None
    redraw()
    redraw_dialog()
    return _INTERVAL


def _start(photos: Path) -> Job | None:
    try:
        command = engine_command(current_python(), "plan", str(photos), "--every-preset")
        return Job.start(
            command, user_folder("preset times"), kind="plan", subject=str(photos), environment=current_environment()
        )
    except HeritageError:
        _keep(photos, {})
        return None


def _keep(photos: Path, stages: dict[str, dict[str, float]]) -> None:
    _known[photos] = stages
    while len(_known) > _MAX_KNOWN:
        _known.popitem(last=False)


def _stages_of(outputs: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Return the seconds of each stage by preset; empty when the engine's answer has another form."""
    try:
        found = {
            str(preset["name"]): {str(one["stage"]): float(one["seconds"]) for one in preset["forecast"]["stages"]}
            for preset in outputs["presets"]
        }
    except (KeyError, TypeError, ValueError):
        return {}
    every = [seconds for stages in found.values() for seconds in stages.values()]
    return found if all(math.isfinite(seconds) and seconds >= 0 for seconds in every) else {}


_timer = Timer(poll)


def register() -> None:
    """Forget a dialog that another file closes, and ask no more once the add-on is gone."""
    add_load_handler(forget_dialog)
    on_unregister(forget_dialog)
    on_unregister(stop)
