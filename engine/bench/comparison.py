"""Trains presets on the same cameras and masks, each in a project of its own, and gathers what they reached."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, stdev
from typing import Any

from ..cameras.settings import CameraSettings
from ..errors import Cancelled, EnvironmentProblem, ProjectError
from ..events import Emit, Event, Metric, Preview, Progress, StageFinished, StageStarted, StopCheck
from ..gaussians import load_gaussians
from ..machine import describe_machine
from ..masks import label_map_path
from ..photos import look_at_photos
from ..pipeline import PipelineSettings, Prepared, prepare, prepare_masks, train_prepared
from ..planning import (
    Calibration,
    PlanSettings,
    WorkPlan,
    calibrate,
    forecast_work,
    plan_scene,
    plan_work,
    require_fit,
    training_settings,
)
from ..project_folder import PROJECT_FILE, ProjectFolder
from ..scene import Gaussians, read_camera_set, read_photo_set
from ..settings import to_dict
from ..training import gaussians_so_far, judge, latest_run, read_progress
from ..training.settings import PRESETS, TrainingSettings
from .settings import EVERYTHING, BenchSettings

__all__ = ["Row", "compare", "pareto_front", "savings"]

_STOPPED = "stopped_at_limit"


@dataclass(frozen=True)
class Row:
    """What one preset reached.

    Attributes
    ----------
    name : str
        The preset, with `EVERYTHING` behind it when leaving-out was switched off.
    seed : int
    steps, planned_steps : int
    n_gaussians : int
    psnr, ssim, l1, flip : float or None
        Of what it ended with, on held-out photos at the largest preset's picture size, the same for all rows; None
        when there is nothing to measure.
    wall_seconds, cpu_seconds : float
        Of training, without the measurements.
    peak_memory : int or None
        Bytes of the process while it trained; None where the system cannot tell, or the row was trained earlier.
    mask_cpu_seconds, mask_wall_seconds : float or None
        Of making its label maps; None when they were there already.
    measured_on : str
        Which photos.
    remark : str
        Why it ended before its last step, or was refused; empty when it did not.
    curve : tuple of dict
        Points of `training.held_out.CurvePoint`, measured while it trained, at its own picture size.
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


def compare(scene: Path, out: Path, settings: BenchSettings, *, emit: Emit, should_stop: StopCheck) -> list[Row]:
    """Train each preset on `scene` and return a row for each.

    Parameters
    ----------
    scene : Path
        Folder with photos, or a project folder, whose cameras and masks are used as they are and which is not changed.
    out : Path
        Here lie the cameras and masks (``scene/``) and a project for each preset. Rows that are done are kept.
    settings : BenchSettings
    emit, should_stop
        See `engine.events`.

    Raises
    ------
    HeritageError
        One of its kinds, with a sentence for the person; a preset that does not fit in memory costs only its row.
    """
    calibration = calibrate(describe_machine(), emit=emit)
    scenes = _Scenes(scene, out, settings, emit, should_stop)
    rows = []
    for preset in settings.presets:
        for leave_out in (True, False) if settings.everything else (True,):
            rows += [_row(scenes, preset, leave_out, seed, calibration) for seed in settings.seeds]
    return rows


class _Scenes:
    """The scene that is trained on, with the masks each kind of run needs; everything is made once.

    Parameters
    ----------
    scene, out : Path
    settings : BenchSettings
    emit, should_stop
        See `engine.events`.
    """

    def __init__(self, scene: Path, out: Path, settings: BenchSettings, emit: Emit, should_stop: StopCheck) -> None:
        self.out, self.settings, self.emit, self.should_stop = out, settings, emit, should_stop
        self._pipeline = PipelineSettings(camera_model=settings.camera_model, photo_masks=settings.photo_masks)
        if (scene / PROJECT_FILE).is_file():
            self._base = _of_project(scene, should_stop)
            self._mask_record = ProjectFolder.open_existing(scene).stage_record("masks") or {}
        else:
            self._base = prepare(scene, out / "scene", self._pipeline, emit=emit, should_stop=should_stop)
            self._mask_record = {}
        self._masked: dict[bool, tuple[Prepared, dict[str, Any]]] = {}

    def plan(self, preset: str, leave_out: bool) -> WorkPlan:
        """Return what a preset does on this scene."""
        wishes = PlanSettings(preset=preset, wants_objects=self.settings.wants_objects, leave_out=leave_out)
        base = self._base
        given = base.camera_set.poses_given
        plan = plan_work(
            base.photo_set, base.looks, wishes, cameras=CameraSettings(), poses_given=given, points_given=given
        )
        # Label maps are made of registered photos only.
        return replace(plan, n_mask_photos=min(plan.n_mask_photos, len(base.camera_set.cameras)))

    def judged(self, row: Row, work: WorkPlan, gaussians: Gaussians | None) -> Row:
        """Return the row with the errors of `gaussians`, at one size for all presets."""
        if gaussians is None:
            return row
        held_out = plan_scene(work, self._base.camera_set).held_out
        names = held_out or tuple(camera.photo for camera in self._base.camera_set.cameras)
        judged = judge(
            gaussians,
            self._base.photo_set.folder,
            self._base.camera_set,
            names,
            max_side=max(PRESETS[preset].max_side for preset in self.settings.presets),
            photo_masks=self._base.photo_set.mask_files,
            should_stop=self.should_stop,
        )
        measured_on = "held-out photos" if held_out else "training photos"
        quality = judged.quality
        return replace(
            row, n_gaussians=len(gaussians), psnr=quality.psnr, ssim=quality.ssim, l1=quality.l1, flip=judged.flip,
            measured_on=measured_on,
        )  # fmt: skip

    def with_masks(self, work: WorkPlan, leave_out: bool) -> tuple[Prepared, dict[str, Any]]:
        """Return what training needs, and the stored record of making its masks, empty where none were made."""
        if leave_out not in self._masked:
            if not work.n_mask_photos:
                self._masked[leave_out] = replace(self._base, masks={}), {}
            elif leave_out and self._base.masks:
                self._masked[leave_out] = self._base, self._mask_record
            else:
                folder = self.out / ("scene" if leave_out else f"scene{EVERYTHING}")
                prepared, project = prepare_masks(
                    self._base, folder, work, self._pipeline, emit=self.emit, should_stop=self.should_stop
                )
                self._masked[leave_out] = prepared, project.stage_record("masks") or {}
        return self._masked[leave_out]


def _of_project(scene: Path, should_stop: StopCheck) -> Prepared:
    """Return the photos, cameras and masks of a finished project, which is only read."""
    project = ProjectFolder.open_existing(scene)
    record = project.stage_record("cameras")
    if record is None:
        raise ProjectError(f"{scene} has no cameras yet. Run reconstruct on its photos first, or name the photos.")
    folder = Path(str(project.get("photo_folder")))
    if not folder.is_dir():
        raise ProjectError(f"The photos of {scene} are no longer in {folder}. Put them back.")
    photo_set = replace(read_photo_set(scene / "photos" / "photos.json"), folder=folder)
    camera_set = read_camera_set(scene / "cameras")
    paths = {camera.photo: label_map_path(scene / "masks", camera.photo) for camera in camera_set.cameras}
    masks = {name: path for name, path in paths.items() if path.is_file()}
    of_masks = project.stage_record("masks") if masks else record
    return Prepared(
        photo_set,
        look_at_photos(photo_set, should_stop=should_stop),
        camera_set,
        masks,
        [record["key"], (of_masks or record)["key"]],
    )


def _row(scenes: _Scenes, preset: str, leave_out: bool, seed: int, calibration: Calibration) -> Row:
    """Train one preset by one seed, or return what it reached before."""
    settings, out = scenes.settings, scenes.out
    name = preset if leave_out else preset + EVERYTHING
    run = name if seed == PRESETS[preset].seed else f"{name} {seed}"
    work = scenes.plan(preset, leave_out)
    training = replace(training_settings(work), seed=seed)
    refused = ""
    forecast = forecast_work(work, training, describe_machine(), calibration)
    try:
        require_fit(forecast, work, calibration)
    except EnvironmentProblem as error:
        refused = str(error)
    prepared, masks = scenes.with_masks(work, leave_out) if not refused else (None, {})
    row = Row(
        name, seed, 0, training.steps, 0, None, None, None, None, 0.0, 0.0, None, masks.get("cpu_seconds"),
        masks.get("wall_seconds"), "", refused, (),
    )  # fmt: skip
    if prepared is None:
        return row
    folder = out / run.replace(" ", "-")
    earlier = _stopped_earlier(folder, training)
    if earlier is not None and settings.limit_minutes is not None and earlier >= settings.limit_minutes:
        return scenes.judged(_stopped(row, _so_far(folder), earlier), work, _gaussians_so_far(folder))
    spent = (_so_far(folder) or {"wall_seconds": 0.0})["wall_seconds"] if earlier is not None else 0.0
    limit = _Limit(settings.limit_minutes, spent, scenes.should_stop)
    try:
        project = train_prepared(prepared, folder, work, training, emit=_named(scenes.emit, run), should_stop=limit)
    except Cancelled:
        if scenes.should_stop() or settings.limit_minutes is None:
            raise
        with ProjectFolder.create(folder) as project:
            project.put(_STOPPED, {"minutes": settings.limit_minutes, "training": to_dict(training)})
        stopped = _stopped(row, _so_far(folder), settings.limit_minutes)
        return scenes.judged(stopped, work, _gaussians_so_far(folder))
    done = _done(row, project.stage_record("training") or {})
    return scenes.judged(done, work, load_gaussians(folder / "gaussians"))


def _stopped_earlier(folder: Path, training: TrainingSettings) -> float | None:
    """Return the limit in minutes at which an earlier run of the same settings was stopped."""
    if not (folder / PROJECT_FILE).is_file():
        return None
    stopped = ProjectFolder.open_existing(folder).get(_STOPPED)
    return float(stopped["minutes"]) if stopped and stopped["training"] == to_dict(training) else None


class _Limit:
    """A `StopCheck` that also says stop when training has taken as long as it may, with what it `spent` before."""

    def __init__(self, minutes: float | None, spent: float, should_stop: StopCheck) -> None:
        self._until = None if minutes is None else time.monotonic() + 60.0 * minutes - spent
        self._should_stop = should_stop

    def __call__(self) -> bool:
        return self._should_stop() or (self._until is not None and time.monotonic() >= self._until)


def _named(emit: Emit, name: str) -> Emit:
    """Return `emit` for the run of one preset: its stage is called after it."""

    def tell(event: Event) -> None:
        if isinstance(event, StageStarted | StageFinished | Progress | Metric | Preview):
            event = replace(event, stage=f"{event.stage} {name}")
        emit(event)

    return tell


def _so_far(folder: Path) -> dict[str, Any] | None:
    """Return how far an unfinished training in a project came."""
    run = latest_run(folder / "checkpoints")
    return None if run is None else read_progress(run)


def _gaussians_so_far(folder: Path) -> Gaussians | None:
    run = latest_run(folder / "checkpoints")
    return None if run is None else gaussians_so_far(run)


def _stopped(row: Row, so_far: dict[str, Any] | None, minutes: float) -> Row:
    if so_far is None:
        return replace(row, remark=f"stopped at the limit of {minutes:g} min before its first step")
    return replace(
        row, steps=so_far["step"], wall_seconds=so_far["wall_seconds"], cpu_seconds=so_far["cpu_seconds"],
        curve=tuple(so_far["curve"]),
        remark=f"stopped at the limit of {minutes:g} min, step {so_far['step']} of {row.planned_steps}",
    )  # fmt: skip


def _done(row: Row, record: dict[str, Any]) -> Row:
    figures = record["figures"]
    remark = ""
    if figures.get("stopped_early"):
        remark = f"its curve was flat at step {figures['steps']} of {row.planned_steps}"
    return replace(
        row, steps=figures["steps"], wall_seconds=figures["wall_seconds"], cpu_seconds=figures["cpu_seconds"],
        peak_memory=record.get("peak_memory"), remark=remark, curve=tuple(figures["curve"]),
    )  # fmt: skip


def pareto_front(rows: Sequence[Row]) -> list[bool]:
    """Return for each row whether no other one is as good in less CPU time, or better in as much; False without PSNR.

    CPU seconds, since wall seconds also say what else the machine did.
    """

    def beats(one: Row, other: Row) -> bool:
        if one.psnr is None or other.psnr is None:
            return False
        no_worse = one.psnr >= other.psnr and one.cpu_seconds <= other.cpu_seconds
        return no_worse and (one.psnr > other.psnr or one.cpu_seconds < other.cpu_seconds)

    return [row.psnr is not None and not any(beats(other, row) for other in rows) for row in rows]


def savings(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return for each preset trained both ways what leaving out saved and cost.

    Returns
    -------
    dict
        Preset to ``training_cpu_seconds``, ``training_share``, ``mask_cpu_seconds`` (where both were measured),
        ``share`` (of training and masks together) and ``psnr_lost`` in dB, all means over the seeds that were trained
        both ways; ``psnr_lost_error`` is the standard error of that mean, there with two seeds or more.
    """
    by_run = {(row.name, row.seed): row for row in rows}
    both: dict[str, list[tuple[Row, Row, float]]] = {}
    for row in rows:
        full = by_run.get((row.name + EVERYTHING, row.seed))
        if full is None or row.psnr is None or full.psnr is None or "limit" in row.remark + full.remark:
            continue
        both.setdefault(row.name, []).append((row, full, full.psnr - row.psnr))
    found = {}
    for name, runs in both.items():
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
