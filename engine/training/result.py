"""What training hands on, and the figures that tell how it went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ..scene import Gaussians
from .checkpoint import RunState
from .guards import LIMITS
from .held_out import CurvePoint, expected_gain
from .schedule import Schedule
from .settings import TrainingSettings

__all__ = ["TrainingResult", "result_of"]


@dataclass(frozen=True)
class TrainingResult:
    """What training hands on.

    Attributes
    ----------
    gaussians : Gaussians
        With features as they are blended: normalised, unless ``feature_init="paper"``.
    curve : tuple of CurvePoint
        Error on held-out photos against run time.
    figures : dict
        JSON values: steps, Gaussians, seconds, final errors, which photos were measured, guards that fired,
        and in ``limits`` how often values were kept at the method's limits, summed over the steps.
    """

    gaussians: Gaussians
    curve: tuple[CurvePoint, ...]
    figures: dict[str, Any]


def result_of(
    state: RunState,
    settings: TrainingSettings,
    schedule: Schedule,
    *,
    photos: Sequence[str],
    measured_on: str,
    measured: Sequence[str],
) -> TrainingResult:
    """Return what a finished run hands on.

    Parameters
    ----------
    state : RunState
    settings : TrainingSettings
    schedule : Schedule
    photos : sequence of str
        Names of the photos that were trained on.
    measured_on : str
        Which kind of photos the error was measured on.
    measured : sequence of str
        Their names.
    """
    last = state.curve[-1]
    figures: dict[str, Any] = {
        "steps": state.step,
        "stopped_early": _stopped_early(state, settings, schedule),
        "n_gaussians": len(state.parameters),
        "wall_seconds": last.wall_seconds,
        "cpu_seconds": last.cpu_seconds,
        "psnr": last.psnr,
        "ssim": last.ssim,
        "l1": last.l1,
        "measured_on": measured_on,
        "measured_photos": list(measured),
        "background": "black",
        "sh_degree": schedule.sh_degree(state.step - 1, state.sh_limit),
        "trials": [asdict(trial) for trial in state.trials],
        "features": "features" in state.parameters.values,
        "guards": {name: count for name, count in state.guards.items() if name not in LIMITS},
        "limits": {name: state.guards[name] for name in LIMITS},
        "curve": [asdict(point) for point in state.curve],
        "out_of_place": {
            photos[view]: round(float(mask.mean()), 4) for view, mask in sorted(state.out_of_place.items())
        },
    }
    if state.uses_exposure:
        figures["exposure"] = {
            photo: [round(float(gain), 4) for gain in row.exp()]
            for photo, row in zip(photos, state.exposure.detach(), strict=True)
        }
    unit = settings.feature_init == "unit"
    return TrainingResult(state.parameters.to_gaussians(unit_features=unit), tuple(state.curve), figures)


def _stopped_early(state: RunState, settings: TrainingSettings, schedule: Schedule) -> dict[str, float] | None:
    """Return what the steps that were left out would have cost, at the speed of the last ones."""
    curve, steps, since = state.curve, settings.steps, state.cooling_from
    if since is None:
        return None
    before, last = curve[-2], curve[-1]
    share = (steps - last.step) / (last.step - before.step)
    until_then = [point for point in curve if point.step <= since]
    return {
        "planned_steps": steps,
        "expected_gain": expected_gain(until_then, schedule.flat_checks, steps),
        "limit": settings.stop_when_flat,
        "wall_seconds_saved": share * (last.wall_seconds - before.wall_seconds),
        "cpu_seconds_saved": share * (last.cpu_seconds - before.cpu_seconds),
    }
