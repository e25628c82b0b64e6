"""Forecast of the time and memory of the planned work, with error bars.

A formula gives the CPU seconds of each stage from the plan (`cpu_seconds_of`). They are multiplied by this machine's
slowdown from a short benchmark and by the corrections from earlier runs (`calibration`). Wall seconds follow from CPU
seconds (`stage_forecast`). The constants were fitted on two cores of a shared server; docs/design_notes/planning.md
lists the measurements.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from ...cameras import comparison_work, detecting_cores, detection_bytes
from ...cameras.settings import CameraSettings
from ...core.system import Machine
from ...objects.settings import SegmentSettings
from ...training.settings import TrainingSettings
from .calibration import Calibration, outcome_name
from .card_forecast import card_slowdown, card_step_seconds
from .decisions import WorkPlan
from .stage_forecast import StageForecast, wall_share, with_work_beside

_SPREAD_80 = 1.2816
"""Standard deviations on either side of the mean that contain 80 % of a normal distribution."""

_PHOTO_SECONDS = 0.03  # chosen on museum_room
"""Reading photos: CPU seconds per photo, for opening it and inspecting its reduced version."""
_PHOTO_MEGAPIXEL_SECONDS = 0.045  # chosen on museum_room, sakharov_statue32
"""Reading photos: CPU seconds per megapixel."""

_FEATURE_MEGAPIXEL_SECONDS = 2.5  # chosen on museum_room, sakharov_statue32
"""Cameras: CPU seconds of feature detection per megapixel of the working copy."""
_COMPARED_PAIR_SECONDS = 0.001  # chosen on museum_room, sakharov_statue32
"""Cameras: CPU seconds per pair of 600 features in the quick comparison that selects promising pairs."""
_MATCHED_PAIR_SECONDS = 0.065  # chosen on museum_room, sakharov_statue32
"""Cameras: CPU seconds per matched pair."""
_CHECKED_PAIR_SECONDS = 0.012  # chosen on museum_room
"""Cameras: CPU seconds per matched pair of checking what the photos say against the cameras."""
_MAPPED_PAIR_SECONDS = 0.018  # chosen on museum_room, sakharov_statue32
"""Cameras: CPU seconds of mapping per matched pair."""
_SHARE_WITHOUT_TEXTURE = 0.5  # chosen on museum_room, sakharov_statue32, skull66, banana16
"""Cameras: share of the time that photos without any texture take. The number of features grows with the texture."""
_GIVEN_CAMERAS_SECONDS = 1.0  # chosen on museum_room, sakharov_statue32
"""Cameras: CPU seconds of reading given cameras that have sparse points."""

_MASK_SECONDS = 3.0  # chosen on museum_room, sakharov_statue32
"""Masks: CPU seconds per photo."""
_OBJECTS_SECONDS = 1.0  # chosen on museum_room
"""Objects: CPU seconds of loading models."""
_OBJECT_SECONDS = 0.5  # chosen on museum_room
"""Objects: CPU seconds per prompt."""
_OBJECTS_PHOTO_SECONDS = 0.98  # chosen on museum_room
"""Objects: CPU seconds per photo whose segments are in the graph of the scene and are proposals."""
_OBJECTS_PHOTO_GAUSSIAN_SECONDS = 18e-6  # chosen on museum_room
"""Objects: CPU seconds per such photo and Gaussian."""
_REPORT_SECONDS = 2.0  # chosen on museum_room
"""Report: CPU seconds."""
_REPORT_OBJECT_SECONDS = 0.6  # chosen on museum_room
"""Report: CPU seconds per object."""

_STEP_SECONDS = 0.002  # chosen on museum_room, sakharov_statue32
"""Training: CPU seconds per step."""
_STEP_GAUSSIAN_SECONDS = 0.5e-6  # chosen on museum_room, sakharov_statue32
"""Training: CPU seconds per step and Gaussian."""
_STEP_NUMBER_SECONDS = 0.0217e-6  # chosen on museum_room, sakharov_statue32
"""Training: CPU seconds per step and number that is stored for a Gaussian."""
_STEP_PIXEL_SECONDS = 0.28e-6  # chosen on museum_room, sakharov_statue32
"""Training: CPU seconds per step and pixel with `_REFERENCE_GAUSSIANS` Gaussians."""
_REFERENCE_GAUSSIANS = 20_000
"""Training: number of Gaussians for which `_STEP_PIXEL_SECONDS` holds."""
_FEATURE_STEP_SECONDS = 0.003  # chosen on museum_room, sakharov_statue32
"""Training: additional CPU seconds per step with segmentation features."""
_FEATURE_GAUSSIAN_SECONDS = 0.35e-6  # chosen on museum_room, sakharov_statue32
"""Training: additional CPU seconds per step and Gaussian with segmentation features."""
_FEATURE_PIXEL_SHARE = 0.05  # chosen on museum_room, sakharov_statue32
"""Training: additional share of the pixels' time with segmentation features."""
_GROWTH_FACTOR = 1.05  # chosen on museum_room, sakharov_statue32
"""Training: factor on the time of a step while Gaussians are added."""
_EVALUATION_SHARE = 0.4  # chosen on museum_room, sakharov_statue32
"""Training: time of rendering a photo to measure the error, as a share of a step."""
_LOAD_SECONDS = 0.05  # chosen on museum_room, sakharov_statue32
"""Training: CPU seconds of loading a photo."""
_LOAD_MEGAPIXEL_SECONDS = 0.15  # chosen on museum_room, sakharov_statue32
"""Training: CPU seconds of loading a photo, per megapixel of the training picture."""
POINTS_PER_PHOTO = 220  # chosen on museum_room, sakharov_statue32
"""Training: expected number of sparse points per photo that training starts from."""

_MAX_MASK_PROCESSES = 8
"""Masks beside the cameras: largest number of processes. Each loads SAM."""

_FIRST_PICTURE_SECONDS = 18.0  # chosen on museum_room
"""First picture: CPU seconds, spent while the cameras are estimated by runs that are followed."""

_BARE_PYTHON_BYTES = 65_000_000
"""Memory of Python without the engine's libraries."""
_PYTHON_BYTES = 500_000_000
"""Memory of Python with torch, OpenCV and the compiled kernels."""
_PHOTO_THREAD_BYTES = 25_000_000
"""Reading photos: bytes per thread."""
_PHOTO_PIXEL_BYTES = 4.1
"""Reading photos: bytes per pixel of the largest photo and thread."""
_MAX_PHOTO_PIXELS = 60_000_000
"""Reading photos: larger ones are decoded in a process of their own."""
_MAX_PHOTO_SHARE = 0.75
"""Reading photos: largest share of the free memory. Threads wait for each other rather than use more."""
_COLMAP_BYTES = 230_000_000  # chosen on museum_room, sakharov_statue32, skull66, banana16
"""Cameras: memory of pycolmap and its database."""
_PLACED_PHOTO_BYTES = 2_000_000
"""Cameras: largest memory of a placed photo, in the model, its matches and the models of trials: 500 for a feature."""
_SAM_BYTES = 880_000_000  # chosen on museum_room, sakharov_statue32, skull66, banana16
"""Masks and objects: memory of SAM."""
_KEPT_AFTER_SAM_BYTES = 420_000_000  # chosen on museum_room, sakharov_statue32, skull66, banana16
"""Memory that the process does not return to the system after SAM."""
_TARGET_PIXEL_BYTES = 36
"""Training: bytes per pixel of a prepared target of the loss."""
_MAX_TARGET_BYTES = 1 << 30
"""Training: prepared targets are kept for all photos if they take at most this many bytes, else for one photo."""
_GAUSSIAN_NUMBER_BYTES = 24
"""Training: bytes per number of a Gaussian: value, gradient, two moments, and copies during growth."""
_GAUSSIAN_FEATURE_BYTES = 256
"""Training: additional bytes per Gaussian for blending its segmentation features."""
_DRIVER_BYTES = 300_000_000
"""Training on a graphics card: memory of its driver in this process."""
_FIRST_PICTURE_BYTES = 1_000_000_000  # chosen on museum_room
"""Memory of the process that makes a first picture while the cameras are estimated."""
_VIEW_GAUSSIAN_BYTES = 130
"""Objects: bytes per Gaussian and photo of the views that are kept."""
_MAX_VIEW_BYTES = 500_000_000
"""Objects: largest memory of the views that are kept."""


@dataclass(frozen=True)
class Forecast:
    """Forecast of all stages of a plan.

    Attributes
    ----------
    stages : tuple of StageForecast
    free_memory : int or None
        Bytes that were free when the forecast was made; None if the system does not state it.
    cores : int
    n_runs : int
        Number of earlier runs on this machine that corrected the forecast.
    device : str
        What training is forecast for, see `Device.name`.
    masks_beside : int
        Number of processes that can make masks while the cameras are estimated; 0 without another core, or without
        memory for both.
    picture_beside : bool
        Whether a first picture can be made at the same time: there is memory for it too.
    """

    stages: tuple[StageForecast, ...]
    free_memory: int | None
    cores: int
    n_runs: int
    device: str = "cpu"
    masks_beside: int = 0
    picture_beside: bool = False

    @property
    def seconds(self) -> tuple[float, float, float]:
        """Wall seconds of all stages: low, expected, high. Errors of stages are independent, so their squares add."""
        middle = sum(stage.seconds for stage in self.stages)
        low = math.sqrt(sum((stage.seconds - stage.low) ** 2 for stage in self.stages))
        high = math.sqrt(sum((stage.high - stage.seconds) ** 2 for stage in self.stages))
        return max(0.0, middle - low), middle, middle + high

    @property
    def largest(self) -> StageForecast:
        """The stage that needs the most memory."""
        return max(self.stages, key=lambda stage: stage.memory)


def step_seconds(n_gaussians: int, n_pixels: int, *, sh_degree: int, features: bool) -> float:
    """Return the CPU seconds of one training step on the reference machine.

    Notes
    -----
    The time of projection and Adam is proportional to the number of Gaussians. The time of blending is proportional to
    the pixels and to the Gaussians that cover each pixel, whose number grows as the root of all.
    """
    numbers = 11 + 3 * (sh_degree + 1) ** 2
    pixels = _STEP_PIXEL_SECONDS * n_pixels * math.sqrt(n_gaussians / _REFERENCE_GAUSSIANS)
    seconds = _STEP_SECONDS + n_gaussians * (_STEP_GAUSSIAN_SECONDS + _STEP_NUMBER_SECONDS * numbers) + pixels
    if features:
        seconds += _FEATURE_STEP_SECONDS + _FEATURE_GAUSSIAN_SECONDS * n_gaussians + _FEATURE_PIXEL_SHARE * pixels
    return seconds


def training_seconds(work: WorkPlan, settings: TrainingSettings) -> float:
    """Return the seconds of training: those of a step summed over the schedule with growth and coarse levels.

    CPU seconds of the reference machine with `step_seconds`, or those of the planned card with `card_step_seconds`.
    """
    from ...training import Schedule

    cost, slowdown = step_seconds, 1.0
    if work.device.backend == "gpu":
        cost = card_step_seconds
        slowdown = card_slowdown(work.device.memory, shares_memory=work.device.shares_memory)

    n_trained = max(1, work.n_training)
    schedule = Schedule(settings, n_trained, 1.0)
    pixels = work.width * work.height
    n = _gaussians_at_start(work, settings)
    n_evaluated = min(8, work.n_held_out or n_trained)
    seconds = work.n_photos * (_LOAD_SECONDS + _LOAD_MEGAPIXEL_SECONDS * pixels / 1e6)
    for step in range(settings.schedule.steps):
        degree = schedule.sh_degree(step)
        # Bands of colour that are not used yet are neither evaluated nor optimised.
        step_pixels = round(pixels * schedule.scale(step) ** 2)
        step_cost = slowdown * cost(n, step_pixels, sh_degree=degree, features=work.features)
        growing = (
            settings.growth.grow_from * settings.schedule.steps
            <= step
            < settings.growth.grow_until * settings.schedule.steps
        )
        # A trial takes its steps twice, with and without the tried setting, in addition to the run's own steps.
        times = 1 + 2 * schedule.trial_steps if step in schedule.trials else 1
        seconds += times * step_cost * (_GROWTH_FACTOR if growing else 1.0)
        if schedule.grows(step):
            n = schedule.gaussians_after_growth(step, n)
        n = min(n, schedule.thinnings.get(step + 1, n))
        n_measured = n_evaluated * (step + 1 in schedule.curve_steps)
        n_measured += len(schedule.validation) * 2 * (step in schedule.trials)
        if n_measured:
            full = slowdown * cost(n, pixels, sh_degree=degree, features=False)
            seconds += n_measured * _EVALUATION_SHARE * full
    return seconds


def _gaussians_at_start(work: WorkPlan, settings: TrainingSettings) -> int:
    expected = POINTS_PER_PHOTO * work.n_photos + settings.growth.n_background // 4
    return max(1, min(settings.growth.max_gaussians, expected))


def cpu_seconds_of(stage: str, work: WorkPlan, settings: TrainingSettings, *, n_prompts: int) -> float:
    """Return the CPU seconds of a stage on the reference machine."""
    n, megapixels = work.n_photos, work.photo_width * work.photo_height / 1e6
    if stage == "photos":
        return n * (_PHOTO_SECONDS + _PHOTO_MEGAPIXEL_SECONDS * megapixels)
    if stage == "cameras":
        if work.pairs == "none":
            return _GIVEN_CAMERAS_SECONDS
        n_compared = comparison_work(n) if work.pairs == "promising" else 0.0
        seconds = (
            n * _FEATURE_MEGAPIXEL_SECONDS * _copy_pixels(work) / 1e6
            + n_compared * _COMPARED_PAIR_SECONDS
            + work.n_pairs * (_MATCHED_PAIR_SECONDS + _CHECKED_PAIR_SECONDS)
            + (0.0 if work.poses_given else work.n_pairs * _MAPPED_PAIR_SECONDS)
        )
        return seconds * (_SHARE_WITHOUT_TEXTURE + work.texture)
    if stage == "masks":
        return work.n_mask_photos * _MASK_SECONDS
    if stage == "training":
        return training_seconds(work, settings)
    if stage == "objects":
        each = _OBJECTS_PHOTO_SECONDS + _OBJECTS_PHOTO_GAUSSIAN_SECONDS * settings.growth.max_gaussians
        n_read = min(work.n_mask_photos, SegmentSettings().n_vote_views)
        return _OBJECTS_SECONDS + n_prompts * _OBJECT_SECONDS + n_read * each if n_prompts else 0.0
    return _REPORT_SECONDS + n_prompts * _REPORT_OBJECT_SECONDS


def _copy_pixels(work: WorkPlan) -> float:
    """Return the number of pixels of a working copy, on which features are detected."""
    scale = min(1.0, CameraSettings().max_side / max(work.photo_width, work.photo_height))
    return work.photo_width * work.photo_height * scale**2


def memory_of(
    stage: str,
    work: WorkPlan,
    settings: TrainingSettings,
    *,
    cores: int,
    libraries: int = 0,
    free: int | None = None,
) -> int:
    """Return the expected peak memory of the process in a stage, in bytes.

    Parameters
    ----------
    libraries : int
        Bytes that the libraries take beyond the 500 MB of the reference machine.
    free : int or None
        Bytes that are free, None if unknown.
    """
    pixels, python = work.width * work.height, _PYTHON_BYTES + libraries
    full = work.photo_width * work.photo_height
    if stage == "photos":
        per_thread = _PHOTO_THREAD_BYTES + _PHOTO_PIXEL_BYTES * min(full, _MAX_PHOTO_PIXELS)
        most = math.inf if free is None else _MAX_PHOTO_SHARE * free
        return int(min(_BARE_PYTHON_BYTES + per_thread * min(8, cores), most))
    if stage == "cameras":
        if work.pairs == "none":
            return python
        copy = _copy_pixels(work)
        detecting = detection_bytes(copy) * detecting_cores(cores, copy, free=free)
        return int(python + _COLMAP_BYTES + max(detecting, _PLACED_PHOTO_BYTES * work.n_photos))
    if stage == "masks":
        return python + _SAM_BYTES
    on_card = work.device.backend == "gpu"
    targets = _TARGET_PIXEL_BYTES * pixels * work.n_photos
    kept_targets = targets if targets <= _MAX_TARGET_BYTES else _TARGET_PIXEL_BYTES * pixels
    channels = 3 + 16 * work.features
    numbers = 11 + 3 * (work.sh_degree + 1) ** 2 + 16 * work.features
    blended = _GAUSSIAN_FEATURE_BYTES if work.features and not on_card else 0
    gaussians = settings.growth.max_gaussians * (_GAUSSIAN_NUMBER_BYTES * numbers + blended)
    # Photos (where they take more than 1 GiB, in a file whose pages the system takes back), runs of segments, and the
    # rendered picture with its channels and gradients.
    photos = pixels * (3 * work.n_photos + work.n_mask_photos)
    training = python + photos + gaussians + pixels * (60 + 16 * channels)
    if on_card:
        training += _DRIVER_BYTES + (work.device.n_bytes if work.device.shares_memory else 0)
    else:
        training += kept_targets
    training += _KEPT_AFTER_SAM_BYTES if work.n_mask_photos else 0
    # The process returns nothing to the system before objects and report.
    views = min(_MAX_VIEW_BYTES, _VIEW_GAUSSIAN_BYTES * settings.growth.max_gaussians * work.n_photos)
    return training + _SAM_BYTES + views if stage == "objects" else training


def forecast_work(
    work: WorkPlan,
    settings: TrainingSettings,
    machine: Machine,
    calibration: Calibration,
    *,
    n_prompts: int = 0,
) -> Forecast:
    """Return the expected time and memory of every stage of the plan on this machine.

    Parameters
    ----------
    settings : TrainingSettings
        The result of `decisions.training_settings` for the plan.
    n_prompts : int
        Number of objects to be isolated.
    """
    stages = ["photos", "cameras"]
    stages += ["masks"] if work.n_mask_photos else []
    stages += ["training"] + (["objects"] if n_prompts else []) + ["report"]
    expected = tuple(_forecast_stage(stage, work, settings, machine, calibration, n_prompts) for stage in stages)
    memory = {stage.stage: stage.memory for stage in expected}
    cameras, masks = memory["cameras"], memory.get("masks", 0)
    free = math.inf if machine.free_bytes is None else machine.free_bytes
    estimates, n_masks = machine.cores > 1 and not work.poses_given, 0
    if estimates and masks:
        n_masks = int(min(_mask_processes(machine.cores), max(0.0, (free - cameras) / masks)))
    pictures = estimates and cameras + n_masks * masks + _FIRST_PICTURE_BYTES <= free
    picture_seconds = _FIRST_PICTURE_SECONDS * calibration.slowdown("training") if pictures else 0.0
    return Forecast(
        with_work_beside(expected, machine.cores, n_masks, picture_seconds) if estimates else expected,
        machine.free_bytes,
        machine.cores,
        calibration.n_runs,
        work.device.name,
        masks_beside=n_masks,
        picture_beside=pictures,
    )


def _forecast_stage(
    stage: str,
    work: WorkPlan,
    settings: TrainingSettings,
    machine: Machine,
    calibration: Calibration,
    n_prompts: int,
) -> StageForecast:
    outcome = outcome_name(stage, work.device.name)
    model_cpu = cpu_seconds_of(stage, work, settings, n_prompts=n_prompts) * calibration.slowdown(outcome)
    model_memory = memory_of(
        stage,
        work,
        settings,
        cores=machine.cores,
        libraries=calibration.extra_library_memory,
        free=machine.free_bytes,
    )
    cpu, wall, memory = (calibration.correction(outcome, quantity) for quantity in ("cpu", "wall", "memory"))
    cpu_seconds = model_cpu * math.exp(cpu.mean)
    share = wall_share(outcome, machine.cores)
    seconds = cpu_seconds * share * math.exp(wall.mean)
    spread = math.exp(_SPREAD_80 * math.sqrt(cpu.variance + wall.variance))
    peak = model_memory * math.exp(memory.mean)
    memory_spread = math.exp(_SPREAD_80 * math.sqrt(memory.variance))
    return StageForecast(
        stage, seconds, seconds / spread, seconds * spread, cpu_seconds, model_cpu,
        int(peak), int(peak / memory_spread), int(peak * memory_spread), model_memory, share,
    )  # fmt: skip


def _mask_processes(cores: int) -> int:
    """Return the number of processes that make masks beside the cameras: each takes two cores, half of all are left."""
    return max(1, min(_MAX_MASK_PROCESSES, cores // 4))


def forecast_as_dict(forecast: Forecast) -> dict[str, Any]:
    """Return the forecast as JSON values, with the wall seconds of all stages together."""
    return {**asdict(forecast), "seconds": list(forecast.seconds)}
