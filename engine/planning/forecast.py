"""How long the planned work takes and how much memory it needs, with error bars.

Each stage's CPU seconds come from a formula in what the plan says (`cpu_seconds_of`), times what a short benchmark and
earlier runs on this machine say about its speed (`calibration`). Wall seconds are CPU seconds times the share that is
left when the cores divide the work, Amdahl's s + (1 - s) / cores. Constants were fitted on two cores of a shared
server; sources stand beside them.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..cameras.settings import CameraSettings
from ..errors import EnvironmentProblem
from ..machine import Machine
from ..training.settings import PRESETS, TrainingSettings
from .calibration import Calibration
from .decisions import WorkPlan

__all__ = [
    "Forecast",
    "StageForecast",
    "as_dict",
    "cpu_seconds_of",
    "forecast_work",
    "memory_of",
    "require_fit",
    "step_seconds",
    "training_cpu_seconds",
    "wall_share",
]

_SPREAD_80 = 1.2816
"""Standard deviations on either side of the middle that hold 8 of 10 outcomes of a normal distribution."""

# Photos: two sets, 0.047 CPU s a megapixel; and a small version is looked at.
_PHOTO_SECONDS, _PHOTO_MEGAPIXEL_SECONDS = 0.006, 0.045
# Cameras: 2.2 to 3.2 CPU s a megapixel of working copy, 5 ms a pair looked at, 56 to 75 ms a pair matched, mapping
# 4.5 s of 32 photos and 12 s of 48. Features, and with them all that is done with them, are found where there is
# texture: three sets with 0.47 to 0.55 of their pixels took 0.8 to 1.2 of the formula, one with 0.11 took 0.6.
_WITHOUT_TEXTURE = 0.5
_FEATURE_MEGAPIXEL_SECONDS, _LOOK_PAIR_SECONDS, _MATCH_SECONDS, _MAPPING_SECONDS = 2.5, 0.005, 0.065, 0.03
_GIVEN_SECONDS = 1.0
# Masks: 6.2 and 7.8 CPU s a photo in two sets.
_MASK_SECONDS = 6.5
# Objects: 140 and 166 CPU s for 8 prompts, of which 8 the first time a vocabulary is read.
_OBJECT_SECONDS, _OBJECTS_START = 18.0, 8.0
_REPORT_SECONDS = 4.0
# Training: fitted to 9 runs of 20 steps with 10,000 to 40,000 trained Gaussians on 160 to 640 pixels: within 12 %.
_STEP, _PER_GAUSSIAN, _PER_GAUSSIAN_FLOAT, _PER_PIXEL, _PIXELS_MEANT_FOR = 0.002, 0.5e-6, 0.0217e-6, 0.28e-6, 20_000
# Features, and growing, against the curves of two runs of 3,000 steps.
_FEATURE_STEP, _FEATURE_PER_GAUSSIAN, _FEATURE_PIXELS, _GROWTH = 0.003, 0.35e-6, 0.05, 1.05
_MEASURED_SHARE = 0.4
"""Rendering a photo forward takes this share of a step."""
_LOAD_MEGAPIXEL_SECONDS, _LOAD_SECONDS = 0.15, 0.05
POINTS_A_PHOTO = 220
"""Sparse points a photo that training starts from: 202 and 235 in two sets."""

_SERIAL = {"photos": 0.1, "cameras": 0.12, "masks": 0.1, "training": 0.16, "objects": 0.6, "report": 0.9}
"""Part of the work that one core does alone."""
_MOST_CORES = {"masks": 2}
"""SAM's session takes two threads."""

_BARE_PYTHON = 65_000_000
_PYTHON = 500_000_000
"""Python with torch, OpenCV and the compiled kernels, measured."""
_LEFT_BY_MASKS = 420_000_000
"""What the process does not give back after SAM: 260 to 650 MB in four runs."""
_COLMAP = 230_000_000
"""What pycolmap and its database hold besides: 180 to 350 MB in four runs."""
_COLMAP_PIXEL = 260
"""Bytes a pixel of a working copy that SIFT on the doubled picture takes on each thread."""
_SAM = 880_000_000
"""770 to 1,020 MB in four runs."""
_VIEW_GAUSSIAN, _MOST_VIEWS = 130, 500_000_000
_TARGET_PIXEL, _MOST_TARGETS = 36, 1 << 30
_GAUSSIAN_FLOAT, _GAUSSIAN_FEATURE = 24, 256
"""Bytes: value, gradient, two moments, and copies while growing; and what blending 16 features takes besides."""


@dataclass(frozen=True)
class StageForecast:
    """What a stage is expected to take.

    Attributes
    ----------
    stage : str
    seconds, low, high : float
        Wall; 8 of 10 runs are expected between `low` and `high`.
    cpu_seconds : float
    model_cpu_seconds : float
        What the formula says before corrections by earlier runs: what outcomes are compared with.
    memory, memory_low, memory_high : int
        Most bytes the process holds, likewise.
    model_memory : int
    """

    stage: str
    seconds: float
    low: float
    high: float
    cpu_seconds: float
    model_cpu_seconds: float
    memory: int
    memory_low: int
    memory_high: int
    model_memory: int


@dataclass(frozen=True)
class Forecast:
    """All stages of a plan.

    Attributes
    ----------
    stages : tuple of StageForecast
    free_memory : int or None
        When the forecast was made.
    cores : int
    n_runs : int
        Earlier runs on this machine that corrected it.
    """

    stages: tuple[StageForecast, ...]
    free_memory: int | None
    cores: int
    n_runs: int

    @property
    def seconds(self) -> tuple[float, float, float]:
        """Wall seconds together: low, expected, high. Stages err independently: their deviations add as squares."""
        middle = sum(stage.seconds for stage in self.stages)
        low = math.sqrt(sum((stage.seconds - stage.low) ** 2 for stage in self.stages))
        high = math.sqrt(sum((stage.high - stage.seconds) ** 2 for stage in self.stages))
        return max(0.0, middle - low), middle, middle + high

    @property
    def largest(self) -> StageForecast:
        """The stage that needs most memory."""
        return max(self.stages, key=lambda stage: stage.memory)


def step_seconds(n_gaussians: int, n_pixels: int, *, sh_degree: int, features: bool) -> float:
    """Return the CPU seconds of one training step on the reference machine.

    Notes
    -----
    2 ms + N (0.5 us + 0.0217 us a number of the Gaussian) + 0.28 us P sqrt(N / 20,000): projection and Adam go with
    the number of Gaussians N, blending with the pixels P and how many Gaussians lie over each, which grows slower than
    their number. Features: 3 ms + 0.35 us N more, pixels 5 % dearer.
    """
    numbers = 11 + 3 * (sh_degree + 1) ** 2
    pixels = _PER_PIXEL * n_pixels * math.sqrt(n_gaussians / _PIXELS_MEANT_FOR)
    seconds = _STEP + n_gaussians * (_PER_GAUSSIAN + _PER_GAUSSIAN_FLOAT * numbers) + pixels
    if features:
        seconds += _FEATURE_STEP + _FEATURE_PER_GAUSSIAN * n_gaussians + _FEATURE_PIXELS * pixels
    return seconds


def training_cpu_seconds(work: WorkPlan, settings: TrainingSettings, *, steps: int | None = None) -> float:
    """Return the CPU seconds of training: `step_seconds` summed over the schedule with growth and coarse levels.

    Parameters
    ----------
    work : WorkPlan
    settings : TrainingSettings
    steps : int, optional
        Only the first so many; what a run that stopped early is compared with.
    """
    from ..training import Schedule

    n_trained = max(1, work.n_photos - work.n_held_out)
    schedule = Schedule(settings, n_trained, 1.0)
    pixels = work.width * work.height
    n = _gaussians_at_start(work, settings)
    measured = min(8, work.n_held_out or n_trained)
    seconds = work.n_photos * (_LOAD_SECONDS + _LOAD_MEGAPIXEL_SECONDS * pixels / 1e6)
    for step in range(settings.steps if steps is None else min(steps, settings.steps)):
        degree = schedule.sh_degree(step)
        # Bands not yet used are carried along, but neither evaluated nor stepped.
        one = step_seconds(n, round(pixels * schedule.scale(step) ** 2), sh_degree=degree, features=work.features)
        growing = settings.grow_from * settings.steps <= step < settings.grow_until * settings.steps
        # A trial does its steps with and without what is tried, and they do not count.
        times = 1 + 2 * schedule.trial_steps if step in schedule.trials and work.n_held_out else 1
        seconds += times * one * (_GROWTH if growing else 1.0)
        if schedule.grows(step):
            n = schedule.gaussians_after_growth(step, n)
        if step + 1 in schedule.curve_steps:
            full = step_seconds(n, pixels, sh_degree=degree, features=False)
            seconds += measured * _MEASURED_SHARE * full
    return seconds


def _gaussians_at_start(work: WorkPlan, settings: TrainingSettings) -> int:
    expected = POINTS_A_PHOTO * work.n_photos + int(settings.background * settings.max_gaussians)
    return max(1, min(settings.max_gaussians, expected))


def cpu_seconds_of(stage: str, work: WorkPlan, settings: TrainingSettings, *, n_prompts: int) -> float:
    """Return the CPU seconds of a stage on the reference machine.

    Notes
    -----
    photos: 0.006 + 0.045 s a megapixel, each. cameras: 2.5 s a megapixel of working copy, 5 ms a pair looked at, 65 ms
    a pair matched, 0.03 s n^1.5 for mapping n photos, all times 0.5 + the share of textured pixels. masks: 6.5 s a
    photo. training: `training_cpu_seconds`. objects: 8 s and 18 s a prompt. report: 4 s.
    """
    n, megapixels = work.n_photos, work.photo_width * work.photo_height / 1e6
    if stage == "photos":
        return n * (_PHOTO_SECONDS + _PHOTO_MEGAPIXEL_SECONDS * megapixels)
    if stage == "cameras":
        if work.pairs == "none":
            return _GIVEN_SECONDS
        looked = n * (n - 1) / 2 if work.pairs == "promising" else 0.0
        found = (
            n * _FEATURE_MEGAPIXEL_SECONDS * _copy_pixels(work) / 1e6
            + looked * _LOOK_PAIR_SECONDS
            + work.n_pairs * _MATCH_SECONDS
            + (0.0 if work.poses_given else _MAPPING_SECONDS * n**1.5)
        )
        return found * (_WITHOUT_TEXTURE + work.texture)
    if stage == "masks":
        return work.n_mask_photos * _MASK_SECONDS
    if stage == "training":
        return training_cpu_seconds(work, settings)
    if stage == "objects":
        return _OBJECTS_START + n_prompts * _OBJECT_SECONDS if n_prompts else 0.0
    return _REPORT_SECONDS


def _copy_pixels(work: WorkPlan) -> float:
    scale = min(1.0, CameraSettings().max_side / max(work.photo_width, work.photo_height))
    return work.photo_width * work.photo_height * scale**2


def memory_of(stage: str, work: WorkPlan, settings: TrainingSettings, *, cores: int, libraries: int = 0) -> int:
    """Return the most bytes the process holds in a stage.

    Parameters
    ----------
    stage : str
    work : WorkPlan
    settings : TrainingSettings
    cores : int
    libraries : int
        What Python's libraries hold beyond the 500 MB of the reference machine.

    Notes
    -----
    photos: 65 MB and 15 bytes a pixel on each thread. All others: 500 MB for Python, torch and the compiled kernels,
    and: cameras: 230 MB and 260 bytes a pixel of working copy on each thread. masks, objects: SAM, 880 MB. training:
    each photo's pixels (3 bytes), labels and their index (12) and prepared target (36, when all stay within 1 GiB), 24
    bytes a number and 256 a feature-carrying Gaussian, the picture being made with its channels and their gradients,
    and 420 MB that SAM left. A process gives little back: report holds what training held, and objects SAM besides and
    130 bytes a Gaussian of each photo's view, up to 500 MB (the museum room held 3.1 GB, 0.25 GB of which are spared
    since).
    """
    pixels, python = work.width * work.height, _PYTHON + libraries
    full = work.photo_width * work.photo_height
    if stage == "photos":
        return _BARE_PYTHON + 15 * full * min(8, cores)
    if stage == "cameras":
        if work.pairs == "none":
            return python
        return int(python + _COLMAP + _COLMAP_PIXEL * _copy_pixels(work) * min(4, cores))
    if stage == "masks":
        return python + _SAM
    targets = _TARGET_PIXEL * pixels * work.n_photos
    kept = targets if targets <= _MOST_TARGETS else _TARGET_PIXEL * pixels
    channels = 3 + 16 * work.features
    numbers = 11 + 3 * (work.sh_degree + 1) ** 2 + 16 * work.features
    gaussians = settings.max_gaussians * (_GAUSSIAN_FLOAT * numbers + _GAUSSIAN_FEATURE * work.features)
    photos = pixels * (3 * work.n_photos + 12 * work.n_mask_photos)
    training = python + photos + kept + gaussians + pixels * (60 + 16 * channels)
    training += _LEFT_BY_MASKS if work.n_mask_photos else 0
    views = min(_MOST_VIEWS, _VIEW_GAUSSIAN * settings.max_gaussians * work.n_photos)
    return training + _SAM + views if stage == "objects" else training


def forecast_work(
    work: WorkPlan,
    settings: TrainingSettings,
    machine: Machine,
    calibration: Calibration,
    *,
    n_prompts: int = 0,
) -> Forecast:
    """Return what every stage of the plan is expected to take on this machine.

    Parameters
    ----------
    work : WorkPlan
    settings : TrainingSettings
        Of `decisions.training_settings`.
    machine : Machine
    calibration : Calibration
    n_prompts : int
        Objects to be isolated.
    """
    stages = ["photos", "cameras"]
    stages += ["masks"] if work.n_mask_photos else []
    stages += ["training"] + (["objects"] if n_prompts else []) + ["report"]
    return Forecast(
        tuple(_stage(stage, work, settings, machine, calibration, n_prompts) for stage in stages),
        machine.free_bytes,
        machine.cores,
        calibration.n_runs,
    )


def _stage(
    stage: str,
    work: WorkPlan,
    settings: TrainingSettings,
    machine: Machine,
    calibration: Calibration,
    n_prompts: int,
) -> StageForecast:
    model_cpu = cpu_seconds_of(stage, work, settings, n_prompts=n_prompts) * calibration.slowness(stage)
    model_memory = memory_of(stage, work, settings, cores=machine.cores, libraries=calibration.more_memory)
    cpu, wall, memory = (calibration.learned(stage, what) for what in ("cpu", "wall", "memory"))
    cpu_seconds = model_cpu * math.exp(cpu.mean)
    seconds = cpu_seconds * wall_share(stage, machine.cores) * math.exp(wall.mean)
    bar = math.exp(_SPREAD_80 * math.sqrt(cpu.variance + wall.variance))
    held = model_memory * math.exp(memory.mean)
    memory_bar = math.exp(_SPREAD_80 * math.sqrt(memory.variance))
    return StageForecast(
        stage, seconds, seconds / bar, seconds * bar, cpu_seconds, model_cpu,
        int(held), int(held / memory_bar), int(held * memory_bar), model_memory,
    )  # fmt: skip


def wall_share(stage: str, cores: int) -> float:
    """Return the wall seconds a CPU second takes on so many idle cores: Amdahl's law."""
    cores = min(cores, _MOST_CORES.get(stage, cores))
    return _SERIAL[stage] + (1.0 - _SERIAL[stage]) / cores


def require_fit(forecast: Forecast, work: WorkPlan, calibration: Calibration) -> None:
    """Refuse work whose memory is not there.

    Raises
    ------
    EnvironmentProblem
        When a stage is expected to need more than is free; the sentence says how much, and what would fit.
    """
    free, largest = forecast.free_memory, forecast.largest
    if free is None or largest.memory <= free:
        return
    about = f"{work.max_gaussians:,} Gaussians, {work.n_photos} photos of {work.width} x {work.height} pixels"
    fitting = _presets_that_fit(work, forecast.cores, calibration, free)
    if fitting:
        change = "Choose " + " or ".join(f"--preset {name} (needs {_gb(need)})" for name, need in fitting)
        change += ", or close other programs."
    else:
        change = "No preset fits: close other programs, use fewer photos, or a machine with more memory."
    raise EnvironmentProblem(
        f"The preset {work.preset} needs about {_gb(largest.memory)} of memory for {largest.stage} ({about}), and "
        f"{_gb(free)} are free. {change}"
    )


def _presets_that_fit(work: WorkPlan, cores: int, calibration: Calibration, free: int) -> list[tuple[str, int]]:
    """Return the smaller presets that fit and their need, the largest first."""
    fitting = []
    for name in ("best", "standard", "preview"):
        preset = PRESETS[name]
        scale = min(1.0, preset.max_side / max(work.photo_width, work.photo_height))
        other = replace(
            work, preset=name, max_gaussians=preset.max_gaussians, sh_degree=preset.sh_degree, steps=preset.steps,
            width=round(work.photo_width * scale), height=round(work.photo_height * scale),
        )  # fmt: skip
        stages = ["photos", "cameras", "training"] + (["masks"] if work.n_mask_photos else [])
        need = max(
            int(
                memory_of(stage, other, preset, cores=cores, libraries=calibration.more_memory)
                * math.exp(calibration.learned(stage, "memory").mean)
            )
            for stage in stages
        )
        if need <= free and name != work.preset and preset.max_gaussians < work.max_gaussians:
            fitting.append((name, need))
    return fitting


def _gb(value: int) -> str:
    return f"{value / 1e9:.1f} GB"


def as_dict(forecast: Forecast) -> dict[str, Any]:
    """Return the forecast as JSON values, with the sum of the seconds."""
    return {**asdict(forecast), "seconds": list(forecast.seconds)}
