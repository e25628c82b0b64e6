"""Plan and forecast of a run together, as the commands ``plan`` and ``reconstruct`` make them before any work."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ...cameras.settings import CameraSettings
from ...core.events import Emit, StopCheck
from ...core.files import check, parse_json
from ...core.system import describe_machine
from ...photos import PhotoStatistics, inspect_photos, read_photos
from ...photos.settings import PhotoSettings
from ...project.folder import ProjectFolder
from ...rasterizer import Device, choose_device
from ...scene import PhotoSet
from .benchmark import calibrate
from .calibration import Calibration
from .decisions import PlanSettings, WorkPlan, plan_work, training_settings, work_plan_as_dict
from .device_choice import choose_sizes
from .forecast import Forecast, forecast_as_dict, forecast_work

_STORED_FORECAST = {"stages": [{"stage": str}]}


class PlannedWork(NamedTuple):
    """A plan, its forecast, and the calibration that the forecast is based on."""

    work: WorkPlan
    forecast: Forecast
    calibration: Calibration


def plan_presets(
    folder: Path,
    settings: PlanSettings,
    presets: Sequence[str],
    *,
    photos: PhotoSettings,
    cameras: CameraSettings,
    given_cameras: Path | None,
    photo_masks: Path | None,
    emit: Emit,
    should_stop: StopCheck,
) -> list[PlannedWork]:
    """Read the photos in `folder`, and plan a run with each of `presets`, without a project.

    The preset of `settings` does not count. See `plan_and_forecast` for the other parameters.

    Raises
    ------
    PhotoError, CameraError
        When there are no usable photos, or no camera model at the given path.
    EnvironmentProblem
        When a graphics card is demanded and there is none, or it does not hold the scene.
    Cancelled
        When `should_stop` returns true.
    """
    criteria = photos.for_lens(cameras.model, is_given=given_cameras is not None)
    photo_set = read_photos(folder, criteria, masks=photo_masks, emit=emit, should_stop=should_stop)
    statistics = inspect_photos(photo_set, should_stop=should_stop)
    device = choose_device(settings.device)
    return [
        plan_and_forecast(
            photo_set, statistics, replace(settings, preset=preset), cameras=cameras,
            given_cameras=given_cameras, n_prompts=0, device=device, kept=None, emit=emit,
        )
        for preset in presets
    ]  # fmt: skip


def plan_and_forecast(
    photo_set: PhotoSet,
    statistics: Sequence[PhotoStatistics],
    settings: PlanSettings,
    *,
    cameras: CameraSettings,
    given_cameras: Path | None,
    n_prompts: int,
    device: Device,
    kept: Mapping[str, int] | None,
    emit: Emit,
) -> PlannedWork:
    """Plan the run and forecast its time and memory on this machine. Measure the machine first if it is not known yet.

    Parameters
    ----------
    statistics : sequence of PhotoStatistics
        Of the same photos.
    given_cameras : Path or None
        Cameras that the user gave.
    n_prompts : int
        Number of objects to be isolated at the end.
    device, kept
        See `choose_sizes`.

    Raises
    ------
    EnvironmentProblem
        When a graphics card is demanded that does not hold the scene.
    """
    points_given = False
    if given_cameras is not None:
        from ...cameras import has_points

        points_given = has_points(given_cameras)
    machine = describe_machine()
    choice = choose_sizes(settings, photo_set, device, kept, free=machine.free_bytes)
    work = plan_work(
        photo_set, statistics, settings,
        cameras=cameras, poses_given=given_cameras is not None, points_given=points_given,
        choice=choice,
    )  # fmt: skip
    calibration = calibrate(machine, emit=emit)
    forecast = forecast_work(work, training_settings(work), machine, calibration, n_prompts=n_prompts)
    return PlannedWork(work, forecast, calibration)


def store_forecast(project: ProjectFolder, work: WorkPlan, forecast: Forecast) -> None:
    """Store plan and forecast, unless an earlier run of the same plan stored them.

    The report compares the run with the forecast that was made before any work.
    """
    planned, expected = _as_stored(work_plan_as_dict(work)), _as_stored(forecast_as_dict(forecast))
    stages = [stage.stage for stage in forecast.stages]
    stored = project.get("forecast")
    is_stored = check(stored, _STORED_FORECAST) is None and stages == [stage["stage"] for stage in stored["stages"]]
    if project.get("work_plan") != planned or not is_stored:
        project.put("work_plan", planned)
        project.put("forecast", expected)


def _as_stored(value: dict[str, Any]) -> Any:
    """Return `value` as it is read from a file: JSON has no tuples."""
    return parse_json(json.dumps(value), dict, source="The plan", advice="Report this error.")
