"""Settings that release 0.1.0 planned where this one plans others, so that what it trained stays done."""

from __future__ import annotations

from typing import Any

from ..core.settings import to_dict
from .settings import PRESETS, TrainingSettings

__all__ = ["former_settings"]

_FORMER_MIN_STEPS = 1500
_FORMER_STOP = 0.05
"""``stop_when_flat`` of all presets but ``test`` and ``paper``."""


def former_settings(settings: TrainingSettings, *, preset: str, n_training: int) -> list[dict[str, Any]]:
    """Return the settings with which release 0.1.0 may have trained the same photos for the same request.

    A release whose defaults are better must not train finished scenes again unasked: their objects would be lost.

    Parameters
    ----------
    settings : TrainingSettings
        Of this release.
    preset : str
        Name of the preset that they come from.
    n_training : int
        Number of training photos.

    Returns
    -------
    list of dict
        As ``project.json`` stores settings. There are several, because that release decided differently whether to
        learn brightness factors, and stopped early only where something was left out.
    """
    mixed = settings.growth.growth_strategy == "mixed"
    former: dict[str, Any] = {"growth": "error", "background": 0.1, "grow_factor": 1.05} if mixed else {}
    steps = settings.schedule.steps
    if settings.schedule.rounds:
        steps = min(steps, max(_FORMER_MIN_STEPS, settings.schedule.rounds * n_training))
    schedule = PRESETS[preset].schedule
    interval = max(1, PRESETS[preset].appearance.sh_interval * steps // schedule.steps)
    values = {**to_dict(settings), **former}
    del values["lambda_exposure"], values["dropout"], values["lambda_opacity_end"]
    if settings.loss.dropout:
        values["sh_degree"] = PRESETS[preset].appearance.sh_degree
    return [
        {**values, "steps": few, "sh_interval": between, "exposure": exposure, "stop_when_flat": stop}
        for few, between in ((steps, interval), (settings.schedule.steps, settings.appearance.sh_interval))
        for exposure in (False, True)
        for stop in (0.0, _FORMER_STOP)
    ]
