"""Result of training: the Gaussians, the error curve and the figures of the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ..scene import Gaussians
from .checkpoint import RunState
from .guards import LIMITS
from .held_out import CurvePoint
from .quality import MeasuredQuality
from .schedule import Schedule
from .settings import TrainingSettings


@dataclass(frozen=True)
class TrainingResult:
    """Result of training.

    Attributes
    ----------
    gaussians : Gaussians
        Their features are normalised, unless ``feature_init="paper"``.
    curve : tuple of CurvePoint
        Error on the test photos against run time; on training photos where there are no test photos.
    figures : dict
        JSON values: steps, number of Gaussians, seconds, final errors (see `MeasuredQuality`), names of the measured
        photos and of the validation photos, counts of the numerical guards, and in ``limits`` how often values were
        clamped to limits of the method.
    """

    gaussians: Gaussians
    curve: tuple[CurvePoint, ...]
    figures: dict[str, Any]


def make_result(
    state: RunState,
    settings: TrainingSettings,
    schedule: Schedule,
    quality: MeasuredQuality,
    *,
    photos: Sequence[str],
    measured_on: str,
    measured: Sequence[str],
) -> TrainingResult:
    """Return the result of a finished run.

    Parameters
    ----------
    quality : MeasuredQuality
        Of the finished Gaussians.
    photos : sequence of str
        Names of the training photos.
    measured_on : str
        Kind of the photos that the error was measured on.
    measured : sequence of str
        Names of these photos.
    """
    last = state.curve[-1]
    figures: dict[str, Any] = {
        "steps": state.step,
        "n_gaussians": len(state.parameters),
        "n_background": state.parameters.n_background,
        "wall_seconds": last.wall_seconds,
        "cpu_seconds": last.cpu_seconds,
        "psnr": last.psnr,
        "ssim": last.ssim,
        "l1": last.l1,
        "fitted_psnr": quality.fitted.psnr,
        "well_seen_psnr": quality.well_seen.psnr if quality.well_seen else None,
        "well_seen_share": quality.well_seen_share,
        "dark_share": quality.dark_share,
        "measured_on": measured_on,
        "measured_photos": list(measured),
        "validation_photos": [photos[view] for view in schedule.validation],
        "background": "black",
        "sh_degree": schedule.sh_degree(state.step - 1, state.sh_limit),
        "trials": [asdict(trial) for trial in state.trials],
        "features": "features" in state.parameters.values,
        "guards": {name: count for name, count in state.guards.items() if name not in LIMITS},
        "limits": {name: state.guards[name] for name in LIMITS},
        "curve": [asdict(point) for point in state.curve],
        "out_of_place": {
            photos[view]: round(float(mask.mean()), 4) for view, mask in sorted(state.transient_masks.items())
        },
    }
    if settings.appearance.exposure:
        figures["exposure"] = {
            photo: [round(float(gain), 4) for gain in row.exp()]
            for photo, row in zip(photos, state.exposure.detach(), strict=True)
        }
    unit = settings.features.feature_init == "unit"
    return TrainingResult(state.parameters.to_gaussians(unit_features=unit), tuple(state.curve), figures)
