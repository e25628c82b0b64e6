"""Plan and forecast together: what both ``plan`` and ``reconstruct`` do before any work."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from ..cameras.settings import CameraSettings
from ..events import Emit, StopCheck
from ..machine import describe_machine
from ..photos import PhotoLook, look_at_photos, read_photos
from ..photos.settings import PhotoSettings
from ..project_folder import ProjectFolder
from ..scene import PhotoSet
from .benchmark import calibrate
from .calibration import Calibration
from .decisions import PlanSettings, WorkPlan, plan_work, training_settings
from .forecast import Forecast, as_dict, forecast_work

__all__ = ["BeforeWork", "plan_and_forecast", "plan_photos", "store_forecast"]


class BeforeWork(NamedTuple):
    """A plan, what it is expected to take, and what that is based on."""

    work: WorkPlan
    forecast: Forecast
    calibration: Calibration


def plan_photos(
    folder: Path,
    settings: PlanSettings,
    *,
    photos: PhotoSettings,
    cameras: CameraSettings,
    model: Path | None,
    photo_masks: Path | None,
    emit: Emit,
    should_stop: StopCheck,
) -> BeforeWork:
    """Read the photos in `folder` and plan, without a project; parameters as of `plan_and_forecast`.

    Raises
    ------
    PhotoError, CameraError
        When there are no usable photos, or no camera model where one was named.
    Cancelled
        When `should_stop` says so.
    """
    photo_set = read_photos(folder, photos, masks=photo_masks, emit=emit, should_stop=should_stop)
    looks = look_at_photos(photo_set, should_stop=should_stop)
    return plan_and_forecast(photo_set, looks, settings, cameras=cameras, model=model, n_prompts=0, emit=emit)


def plan_and_forecast(
    photo_set: PhotoSet,
    looks: Sequence[PhotoLook],
    settings: PlanSettings,
    *,
    cameras: CameraSettings,
    model: Path | None,
    n_prompts: int,
    emit: Emit,
) -> BeforeWork:
    """Decide, and forecast on this machine, which is measured first when it was not yet.

    Parameters
    ----------
    photo_set : PhotoSet
    looks : sequence of PhotoLook
    settings : PlanSettings
    cameras : CameraSettings
    model : Path or None
        Camera model that the person gave.
    n_prompts : int
        Objects to be isolated at the end.
    emit : Emit
    """
    points_given = False
    if model is not None:
        from ..cameras import has_points

        points_given = has_points(model)
    work = plan_work(
        photo_set, looks, settings, cameras=cameras, poses_given=model is not None, points_given=points_given
    )
    machine = describe_machine()
    calibration = calibrate(machine, emit=emit)
    return BeforeWork(
        work, forecast_work(work, training_settings(work), machine, calibration, n_prompts=n_prompts), calibration
    )


def store_forecast(project: ProjectFolder, work: WorkPlan, forecast: Forecast) -> None:
    """Store both, unless the same plan was begun before: what was said before the work is what is judged."""
    planned = json.loads(json.dumps(asdict(work)))
    stages = [stage.stage for stage in forecast.stages]
    before = project.get("forecast") or {"stages": ()}
    if project.get("work_plan") != planned or stages != [stage["stage"] for stage in before["stages"]]:
        project.put("work_plan", planned)
        project.put("forecast", as_dict(forecast))
