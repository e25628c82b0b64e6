"""Training of presets on the same cameras and masks, each in its own project, and a row of results for each."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, stdev
from typing import Any

from ...cameras.settings import CameraSettings
from ...core.errors import Cancelled, EnvironmentProblem
from ...core.events import Emit, Event, Metric, Preview, Progress, StageFinished, StageStarted, StopCheck
from ...core.settings import to_dict
from ...core.system import describe_machine
from ...pipeline.planning import (
    Calibration,
    PlanSettings,
    WorkPlan,
    calibrate,
    choose_sizes,
    forecast_work,
    kept_sizes,
    plan_scene,
    plan_work,
    require_enough_memory,
    training_settings,
)
from ...pipeline.reconstruct import PipelineSettings
from ...project.folder import PROJECT_FILE, ProjectFolder
from ...rasterizer import choose_device
from ...scene import Gaussians
from ...training import gaussians_so_far, latest_run, load_gaussians, measure_quality, read_progress
from ...training.settings import PRESETS, TrainingSettings
from .prepared import PreparedScene, prepare, prepare_masks, read_prepared, train_prepared
from .settings import EVERYTHING, BenchSettings

STOPPED_KEY = "stopped_at_limit"
"""Key in a project of the time limit at which its training was stopped."""


@dataclass(frozen=True)
class Row:
    """Results of one preset.

    Attributes
    ----------
    name : str
        Name of the preset, with the ending `EVERYTHING` when nothing was left out.
    seed : int
    steps, planned_steps : int
    n_gaussians : int
    psnr, ssim, l1, flip : float or None
        Errors of the final Gaussians on test photos, at the picture size of the largest preset for all rows; None
        without Gaussians.
    wall_seconds, cpu_seconds : float
        Time of training without the measurements.
    peak_memory : int or None
        Memory of the process during training, bytes; None when the system does not report it, or for an earlier run.
    mask_cpu_seconds, mask_wall_seconds : float or None
        Time for making its label maps; None when they existed before.
    measured_on : str
        Kind of the photos that were measured.
    remark : str
        Reason why training ended before its last step or was refused, else empty.
    curve : tuple of dict
        Points of `training.held_out.CurvePoint`, measured during training at the picture size of the preset.
    fitted_psnr, well_seen_psnr, well_seen_share, dark_share : float or None
        See `training.quality.MeasuredQuality`.
    device : str
        What was trained on, see `Device.name`.
    """

    name: str
    seed: int
    steps: int
    planned_steps: int
    n_gaussians: int
    psnr: float | None
    ssim: float | None
    l1: float | None
    flip: float | None
    wall_seconds: float
    cpu_seconds: float
    peak_memory: int | None
    mask_cpu_seconds: float | None
    mask_wall_seconds: float | None
    measured_on: str
    remark: str
    curve: tuple[dict[str, Any], ...]
    fitted_psnr: float | None = None
    well_seen_psnr: float | None = None
    well_seen_share: float | None = None
    dark_share: float | None = None
    device: str = "cpu"


def compare(scene: Path, out: Path, settings: BenchSettings, *, emit: Emit, should_stop: StopCheck) -> list[Row]:
    """Train each preset on `scene` and return a row for each.

    Parameters
    ----------
    scene : Path
        Folder with photos, or a project folder, whose cameras and masks are used and which is only read.
    out : Path
        Folder for the cameras and masks (``scene/``) and a project for each preset. Finished rows are kept.
    emit, should_stop
        See `engine.core.events`.

    Raises
    ------
    HeritageError
        When the photos, cameras or masks cannot be used. A preset that needs too much memory fails only its own row.
    """
    calibration = calibrate(describe_machine(), emit=emit)
    compared = _ComparedScene(scene, out, settings, emit, should_stop)
    rows = []
    for preset in settings.presets:
        for leave_out in (True, False) if settings.everything else (True,):
            rows += [_row(compared, preset, leave_out, seed, calibration) for seed in settings.random_seeds]
    return rows


class _ComparedScene:
    """The scene of a comparison, with the masks that each kind of run needs; everything is made once.

    Parameters
    ----------
    emit, should_stop
        See `engine.core.events`.
    """

    def __init__(self, scene: Path, out: Path, settings: BenchSettings, emit: Emit, should_stop: StopCheck) -> None:
        self.out, self.settings, self.emit, self.should_stop = out, settings, emit, should_stop
        self._pipeline = PipelineSettings(given_cameras=settings.given_cameras, photo_masks=settings.photo_masks)
        if (scene / PROJECT_FILE).is_file():
            self._base = read_prepared(scene, should_stop)
            self._mask_record = ProjectFolder.open_existing(scene).stage_record("masks") or {}
        else:
            self._base = prepare(scene, out / "scene", self._pipeline, emit=emit, should_stop=should_stop)
            self._mask_record = {}
        self._device = choose_device(settings.device)
        plans = [self.plan(preset, True, out / preset) for preset in settings.presets]
        self._max_side = max(training_settings(plan).schedule.max_side for plan in plans)
        self._masked: dict[bool, tuple[PreparedScene, dict[str, Any]]] = {}

    def plan(self, preset: str, leave_out: bool, folder: Path) -> WorkPlan:
        """Return the work plan of a preset for this scene, with the sizes that its run in `folder` was begun with."""
        plan_settings = PlanSettings(
            preset=preset, device=self.settings.device, wants_objects=self.settings.wants_objects, leave_out=leave_out
        )
        base, is_begun = self._base, (folder / PROJECT_FILE).is_file()
        kept = kept_sizes(ProjectFolder.open_existing(folder), preset) if is_begun else None
        given = base.camera_set.poses_given
        plan = plan_work(
            base.photo_set,
            base.statistics,
            plan_settings,
            cameras=CameraSettings(),
            poses_given=given,
            points_given=given,
            choice=choose_sizes(plan_settings, base.photo_set, self._device, kept, free=describe_machine().free_bytes),
        )
        # Label maps are made of registered photos only.
        return replace(plan, n_mask_photos=min(plan.n_mask_photos, len(base.camera_set.cameras)))

    def with_errors(self, row: Row, work: WorkPlan, gaussians: Gaussians | None) -> Row:
        """Return the row with the errors of `gaussians`, at one size for all presets."""
        if gaussians is None:
            return row
        held_out = plan_scene(work, self._base.camera_set).held_out
        registered = tuple(camera.photo for camera in self._base.camera_set.cameras)
        names = held_out or registered
        measured = measure_quality(
            gaussians,
            self._base.photo_set.folder,
            self._base.camera_set,
            names,
            trained=[name for name in registered if name not in held_out],
            max_side=self._max_side,
            photo_masks=self._base.photo_set.mask_files,
            should_stop=self.should_stop,
        )
        measured_on = "test photos" if held_out else "training photos"
        quality = measured.quality
        return replace(
            row, n_gaussians=len(gaussians), psnr=quality.psnr, ssim=quality.ssim, l1=quality.l1, flip=measured.flip,
            measured_on=measured_on, fitted_psnr=measured.fitted.psnr,
            well_seen_psnr=measured.well_seen.psnr if measured.well_seen else None,
            well_seen_share=measured.well_seen_share, dark_share=measured.dark_share,
        )  # fmt: skip

    def with_masks(self, work: WorkPlan, leave_out: bool) -> tuple[PreparedScene, dict[str, Any]]:
        """Return the input of training, and the stage record of its masks, empty when no masks were made."""
        if leave_out not in self._masked:
            if not work.n_mask_photos:
                self._masked[leave_out] = replace(self._base, label_maps={}), {}
            elif leave_out and self._base.label_maps:
                self._masked[leave_out] = self._base, self._mask_record
            else:
                folder = self.out / ("scene" if leave_out else f"scene{EVERYTHING}")
                prepared, project = prepare_masks(
                    self._base, folder, work, self._pipeline, emit=self.emit, should_stop=self.should_stop
                )
                self._masked[leave_out] = prepared, project.stage_record("masks") or {}
        return self._masked[leave_out]


def _row(compared: _ComparedScene, preset: str, leave_out: bool, seed: int, calibration: Calibration) -> Row:
    """Train one preset with one seed, or return its earlier result."""
    settings, out = compared.settings, compared.out
    name = preset if leave_out else preset + EVERYTHING
    run = name if seed == PRESETS[preset].seed else f"{name} {seed}"
    folder = out / run.replace(" ", "-")
    work = compared.plan(preset, leave_out, folder)
    training = training_settings(work).changed(seed=seed)
    refused = ""
    forecast = forecast_work(work, training, describe_machine(), calibration)
    try:
        require_enough_memory(forecast, work, calibration)
    except EnvironmentProblem as error:
        refused = str(error)
    prepared, masks = compared.with_masks(work, leave_out) if not refused else (None, {})
    row = Row(
        name, seed, 0, training.schedule.steps, 0, None, None, None, None, 0.0, 0.0, None, masks.get("cpu_seconds"),
        masks.get("wall_seconds"), "", refused, (), device=work.device.name,
    )  # fmt: skip
    if prepared is None:
        return row
    earlier = _stopped_earlier(folder, training)
    if earlier is not None and settings.limit_minutes is not None and earlier >= settings.limit_minutes:
        return compared.with_errors(_stopped(row, _progress_in(folder), earlier), work, _gaussians_so_far(folder))
    spent = (_progress_in(folder) or {"wall_seconds": 0.0})["wall_seconds"] if earlier is not None else 0.0
    limit = _TimeLimit(settings.limit_minutes, spent, compared.should_stop)
    try:
        project = train_prepared(
            prepared, folder, work, training, emit=_emit_for(compared.emit, run), should_stop=limit
        )
    except Cancelled:
        if compared.should_stop() or settings.limit_minutes is None:
            raise
        with ProjectFolder.create(folder) as project:
            project.put(STOPPED_KEY, {"minutes": settings.limit_minutes, "training": to_dict(training)})
        stopped = _stopped(row, _progress_in(folder), settings.limit_minutes)
        return compared.with_errors(stopped, work, _gaussians_so_far(folder))
    finished = _finished(row, project.stage_record("training") or {})
    return compared.with_errors(finished, work, load_gaussians(folder / "gaussians"))


def _stopped_earlier(folder: Path, training: TrainingSettings) -> float | None:
    """Return the time limit in minutes at which an earlier run with the same settings was stopped."""
    if not (folder / PROJECT_FILE).is_file():
        return None
    stopped = ProjectFolder.open_existing(folder).get(STOPPED_KEY)
    if not isinstance(stopped, dict) or stopped.get("training") != to_dict(training):
        return None
    minutes = stopped.get("minutes")
    return float(minutes) if isinstance(minutes, int | float) else None


class _TimeLimit:
    """A `StopCheck` that is also true when training, with the seconds it `spent` before, has reached its time limit."""

    def __init__(self, minutes: float | None, spent: float, should_stop: StopCheck) -> None:
        self._until = None if minutes is None else time.monotonic() + 60.0 * minutes - spent
        self._should_stop = should_stop

    def __call__(self) -> bool:
        return self._should_stop() or (self._until is not None and time.monotonic() >= self._until)


def _emit_for(emit: Emit, name: str) -> Emit:
    """Return `emit` for the run of one preset, whose name is appended to the names of stages."""

    def emit_named(event: Event) -> None:
        if isinstance(event, StageStarted | StageFinished | Progress | Metric | Preview):
            event = replace(event, stage=f"{event.stage} {name}")
        emit(event)

    return emit_named


def _progress_in(folder: Path) -> dict[str, Any] | None:
    """Return the progress of an unfinished training in a project."""
    run = latest_run(folder / "checkpoints")
    return None if run is None else read_progress(run)


def _gaussians_so_far(folder: Path) -> Gaussians | None:
    run = latest_run(folder / "checkpoints")
    so_far = None if run is None else gaussians_so_far(run)
    return None if so_far is None else so_far[1]


def _stopped(row: Row, so_far: dict[str, Any] | None, minutes: float) -> Row:
    if so_far is None:
        return replace(row, remark=f"stopped at the limit of {minutes:g} min before its first step")
    return replace(
        row, steps=so_far["step"], wall_seconds=so_far["wall_seconds"], cpu_seconds=so_far["cpu_seconds"],
        curve=tuple(so_far["curve"]),
        remark=f"stopped at the limit of {minutes:g} min, step {so_far['step']} of {row.planned_steps}",
    )  # fmt: skip


def _finished(row: Row, record: dict[str, Any]) -> Row:
    figures = record["figures"]
    return replace(
        row, steps=figures["steps"], wall_seconds=figures["wall_seconds"], cpu_seconds=figures["cpu_seconds"],
        peak_memory=record.get("peak_memory"), curve=tuple(figures["curve"]), device=figures.get("device", "cpu"),
    )  # fmt: skip


def pareto_front(rows: Sequence[Row]) -> list[bool]:
    """Return for each row whether it is on the Pareto front of PSNR and CPU seconds; False without PSNR.

    CPU seconds are used because wall seconds also depend on other programs.
    """

    def dominates(first: Row, second: Row) -> bool:
        if first.psnr is None or second.psnr is None:
            return False
        no_worse = first.psnr >= second.psnr and first.cpu_seconds <= second.cpu_seconds
        return no_worse and (first.psnr > second.psnr or first.cpu_seconds < second.cpu_seconds)

    return [row.psnr is not None and not any(dominates(other, row) for other in rows) for row in rows]


def savings(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return the savings and the cost of leaving out, for each preset that was trained with it and without.

    Returns
    -------
    dict
        Preset to ``training_cpu_seconds``, ``training_share``, ``mask_cpu_seconds`` (where both were measured),
        ``share`` (of training and masks together) and ``psnr_lost`` in dB, all means over the seeds of both kinds of
        runs; ``psnr_lost_error``, for two seeds or more, is the standard error of that mean.
    """
    by_run = {(row.name, row.seed): row for row in rows}
    pairs: dict[str, list[tuple[Row, Row, float]]] = {}
    for row in rows:
        full = by_run.get((row.name + EVERYTHING, row.seed))
        if full is None or row.psnr is None or full.psnr is None or "limit" in row.remark + full.remark:
            continue
        pairs.setdefault(row.name, []).append((row, full, full.psnr - row.psnr))
    found = {}
    for name, runs in pairs.items():
        own, whole = mean(row.cpu_seconds for row, _, _ in runs), mean(full.cpu_seconds for _, full, _ in runs)
        lost = [psnr for _, _, psnr in runs]
        saved = {"training_cpu_seconds": whole - own, "training_share": 1.0 - own / whole, "psnr_lost": mean(lost)}
        if len(lost) > 1:
            saved["psnr_lost_error"] = stdev(lost) / math.sqrt(len(lost))
        row, full, _ = runs[0]
        if full.mask_cpu_seconds is not None:
            masks = row.mask_cpu_seconds or 0.0
            saved["mask_cpu_seconds"] = full.mask_cpu_seconds - masks
            saved["share"] = 1.0 - (own + masks) / (whole + full.mask_cpu_seconds)
        found[name] = saved
    return found
