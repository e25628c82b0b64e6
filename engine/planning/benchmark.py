"""The benchmark behind the forecasts: some training steps, features of two pictures, one SAM encoding, and
what the libraries hold; under 15 s."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelFileError
from ..events import Emit, Progress, ignore_events, never_stop
from ..machine import Machine, cpu_seconds
from ..scene import Gaussians, PinholeCamera
from ..training.settings import TrainingSettings
from .calibration import Benchmark, Calibration, load_calibration

__all__ = ["calibrate", "measure_speed"]

_WIDTH, _HEIGHT, _N, _STEPS, _WARM = 320, 240, 10_000, 30, 3
_PICTURE = (640, 480)


def calibrate(machine: Machine, *, emit: Emit, file: Path | None = None) -> Calibration:
    """Return what is known of this machine, measuring it first when nothing is.

    Parameters
    ----------
    machine : Machine
    emit : Emit
        Told when a benchmark is made.
    file : Path, optional
        See `load_calibration`.
    """
    from ..rasterizer import cache_folder

    def measure() -> Benchmark:
        emit(Progress("planning", 0.0, 10.0, "measuring this machine's speed, once"))
        benchmark = measure_speed()
        emit(Progress("planning", 1.0, 0.0, "this machine's speed is known"))
        return benchmark

    return load_calibration(machine, rasterizer=cache_folder().name, measure=measure, file=file)


def measure_speed() -> Benchmark:
    """Measure this machine.

    Notes
    -----
    CPU seconds, which other programs disturb far less than wall seconds. Where the kernels are not compiled yet, they
    are compiled first (20 s once, needed for training anyway), and that is not counted.
    """
    with tempfile.TemporaryDirectory() as folder:
        step = _training_step(Path(folder) / "training")
        features = _features(Path(folder) / "features")
    return Benchmark(step, features, _sam_encode(), _libraries(), rasterizer="")


def _libraries() -> int | None:
    """Return the most bytes held by a process that has loaded what the stages use and done nothing yet."""
    engine = str(__package__).rpartition(".")[0]
    rooms = ", ".join(f"{engine}.{room}" for room in ("training.loop", "cameras.sfm", "masks.sam"))
    code = f"import {rooms}; from {engine}.machine import peak_memory; print(peak_memory() or 0)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    return int(told) or None


def _training_step(folder: Path) -> float:
    """Return the CPU seconds of a step with 10,000 Gaussians on 320 x 240 pixels, without what starts a run."""
    from ..training import TrainingView, train

    settings = TrainingSettings(
        steps=_STEPS, max_gaussians=_N, sh_degree=0, max_side=_WIDTH, coarse_levels=0, features=False, grow_from=1.0,
        grow_until=1.0, noise=0.0, stop_when_flat=0.0, curve_points=2, checkpoint_interval=10**9,
    )  # fmt: skip
    rng = np.random.default_rng(0)
    pinhole = PinholeCamera(
        np.eye(4), np.array([[300.0, 0.0, _WIDTH / 2], [0.0, 300.0, _HEIGHT / 2], [0.0, 0.0, 1.0]]), _WIDTH, _HEIGHT
    )
    views = [TrainingView(str(i), pinhole, _texture(rng, _WIDTH, _HEIGHT), None, i == 0) for i in range(2)]
    depth = rng.uniform(2.0, 6.0, _N)
    rays = rng.uniform(-0.5, 0.5, (_N, 2)) * (_WIDTH / 300.0, _HEIGHT / 300.0)
    start = Gaussians(
        means=np.column_stack([rays * depth[:, None], depth]).astype(np.float32),
        log_scales=np.log(0.008 * depth[:, None] * rng.uniform(0.5, 2.0, (_N, 3))).astype(np.float32),
        quats=rng.normal(size=(_N, 4)).astype(np.float32),
        opacity_logits=np.full(_N, 1.0, np.float32),
        sh=rng.normal(0.0, 0.5, (_N, 1, 3)).astype(np.float32),
    )
    curve = train(
        start, views, settings, checkpoints=folder, emit=ignore_events, should_stop=never_stop
    ).curve  # The first point lies after the kernels were loaded or compiled.
    first, last = curve[0], curve[-1]
    return (last.cpu_seconds - first.cpu_seconds) / (last.step - first.step)


def _texture(rng: np.random.Generator, width: int, height: int) -> NDArray[np.uint8]:
    """Return blotches of several sizes, uint8 [height, width, 3], in which SIFT finds some thousand features."""
    picture = np.zeros((height, width, 3))
    for cell in (4, 8, 16, 32):
        small = rng.uniform(0.0, 1.0, (-(-height // cell), -(-width // cell), 3))
        picture += small.repeat(cell, axis=0).repeat(cell, axis=1)[:height, :width]
    return np.asarray(255.0 * picture / 4.0, np.uint8)


def _features(folder: Path) -> float:
    """Return the CPU seconds of features in two pictures of 640 x 480 that overlap by three quarters, and a match."""
    from PIL import Image

    from ..cameras import Workshop, match_features
    from ..cameras.settings import CameraSettings
    from ..scene import Photo, PhotoSet

    width, height = _PICTURE
    wide = _texture(np.random.default_rng(1), width + width // 4, height)
    photos = folder / "photos"
    photos.mkdir(parents=True)
    for index, left in enumerate((0, width // 4)):
        Image.fromarray(wide[:, left : left + width]).save(photos / f"{index}.png")
    photo_set = PhotoSet(photos, tuple(Photo(f"{i}.png", width, height, None, str(i)) for i in range(2)), ())
    workshop = Workshop(folder / "work", photo_set, CameraSettings())
    before = cpu_seconds()
    match_features(workshop, report=lambda done, message: None, should_stop=never_stop)
    return cpu_seconds() - before


def _sam_encode() -> float | None:
    """Return the CPU seconds of encoding a picture, None where the model is not there."""
    from ..masks import load_default_sam

    try:
        sam = load_default_sam()
    except ModelFileError:
        return None
    picture = _texture(np.random.default_rng(2), 1024, 768)
    before = cpu_seconds()
    sam.encode(picture)
    return cpu_seconds() - before
