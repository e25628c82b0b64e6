"""Benchmark of this machine for the forecasts: training steps, features of two pictures, one SAM encoding, and the
memory of the libraries. It takes less than 15 s."""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.child_process import child_beside
from ...core.errors import HeritageError, ModelFileError
from ...core.events import Emit, Progress, ignore_events, never_stop
from ...core.system import Machine, cpu_seconds, peak_memory
from ...scene import Gaussians, PinholeCamera
from ...training.settings import TrainingSettings
from .calibration import Benchmark, Calibration, load_calibration

_LOG = logging.getLogger(__name__)

_WIDTH, _HEIGHT = 320, 240
"""Size in pixels of the pictures that are trained on."""
_N_GAUSSIANS = 10_000
"""Number of Gaussians that are trained."""
_STEPS = 30
"""Number of training steps."""
_MEASURE_SECONDS, _COMPILE_SECONDS = 10.0, 20.0
"""Seconds that the measurement takes on two idle cores, and what the first one on a computer takes besides."""
_FEATURE_PICTURE = (640, 480)
"""Width and height in pixels of the pictures in which features are detected."""


def calibrate(machine: Machine, *, emit: Emit) -> Calibration:
    """Return the calibration of this machine. Measure the machine first if there is none.

    Parameters
    ----------
    emit : Emit
        Receives progress events when the machine is measured.
    """
    from ...rasterizer import cache_folder

    def measure() -> Benchmark:
        is_compiled = any(cache_folder().rglob("*.nbc"))
        seconds = _MEASURE_SECONDS if is_compiled else _MEASURE_SECONDS + _COMPILE_SECONDS
        emit(Progress("planning", 0.0, seconds, "measuring this machine's speed, once"))
        benchmark = measure_speed()
        emit(Progress("planning", 1.0, 0.0, "this machine's speed is known"))
        return benchmark

    return load_calibration(machine, rasterizer=cache_folder().name, measure=measure)


def measure_speed() -> Benchmark:
    """Measure this machine in CPU seconds, which other programs disturb far less than wall seconds.

    Notes
    -----
    Kernels that are not compiled yet are compiled first (`_COMPILE_SECONDS`, once; training needs them anyway). The
    measured times do not include this.
    """
    with tempfile.TemporaryDirectory() as folder:
        step = _training_step_seconds(Path(folder) / "training")
        features = _feature_seconds(Path(folder) / "features")
    return Benchmark(step, features, _sam_encode_seconds(), _library_memory(), rasterizer="")


def _library_memory() -> int | None:
    """Return the peak memory in bytes of a process that only loads the libraries of the stages.

    None where it is not known, or where the limits of this process do not admit the libraries.
    """
    work = child_beside("pipeline.planning.benchmark:memory_with_libraries", {}, what="loading the libraries")
    try:
        with work as child:
            memory: int | None = child.result()
    except (HeritageError, ModuleNotFoundError) as error:
        _LOG.warning("The memory of the libraries is not known: %s", error)
        return None
    return memory


def memory_with_libraries() -> int | None:
    """Load the libraries of the stages, and return the peak memory of this process in bytes, None if not known."""
    from ...cameras import estimate_cameras  # noqa: F401
    from ...masks import load_sam  # noqa: F401
    from ...training import train  # noqa: F401

    return peak_memory()


def _training_step_seconds(folder: Path) -> float:
    """Return the CPU seconds of a step with 10,000 Gaussians on 320 x 240 pixels, without the start of the run."""
    from ...training import TrainingView, train

    settings = TrainingSettings().changed(
        steps=_STEPS, max_gaussians=_N_GAUSSIANS, sh_degree=0, max_side=_WIDTH, coarse_levels=0, train_features=False,
        grow_from=1.0, grow_until=1.0, noise=0.0, exposure=False, curve_points=2, checkpoint_interval=10**9,
    )  # fmt: skip
    rng = np.random.default_rng(0)
    pinhole = PinholeCamera(
        np.eye(4), np.array([[300.0, 0.0, _WIDTH / 2], [0.0, 300.0, _HEIGHT / 2], [0.0, 0.0, 1.0]]), _WIDTH, _HEIGHT
    )
    views = [TrainingView(str(i), pinhole, _texture(rng, _WIDTH, _HEIGHT), None, i == 0) for i in range(2)]
    depth = rng.uniform(2.0, 6.0, _N_GAUSSIANS)
    rays = rng.uniform(-0.5, 0.5, (_N_GAUSSIANS, 2)) * (_WIDTH / 300.0, _HEIGHT / 300.0)
    start = Gaussians(
        means=np.column_stack([rays * depth[:, None], depth]).astype(np.float32),
        log_scales=np.log(0.008 * depth[:, None] * rng.uniform(0.5, 2.0, (_N_GAUSSIANS, 3))).astype(np.float32),
        quats=rng.normal(size=(_N_GAUSSIANS, 4)).astype(np.float32),
        opacity_logits=np.full(_N_GAUSSIANS, 1.0, np.float32),
        sh=rng.normal(0.0, 0.5, (_N_GAUSSIANS, 1, 3)).astype(np.float32),
    )
    curve = train(
        start, views, settings, checkpoints=folder, emit=ignore_events, should_stop=never_stop
    ).curve  # Its first point was measured after the kernels were loaded or compiled.
    first, last = curve[0], curve[-1]
    return (last.cpu_seconds - first.cpu_seconds) / (last.step - first.step)


def _texture(rng: np.random.Generator, width: int, height: int) -> NDArray[np.uint8]:
    """Return random squares of several sizes, uint8 [height, width, 3], in which SIFT finds thousands of features."""
    picture = np.zeros((height, width, 3))
    for cell in (4, 8, 16, 32):
        small = rng.uniform(0.0, 1.0, (-(-height // cell), -(-width // cell), 3))
        picture += small.repeat(cell, axis=0).repeat(cell, axis=1)[:height, :width]
    return np.asarray(255.0 * picture / 4.0, np.uint8)


def _feature_seconds(folder: Path) -> float:
    """Return the CPU seconds of detecting and matching features in two 640 x 480 pictures that overlap by 75 %."""
    from PIL import Image

    from ...cameras import SfmWorkspace, match_features
    from ...cameras.settings import CameraSettings
    from ...scene import Photo, PhotoSet

    width, height = _FEATURE_PICTURE
    wide = _texture(np.random.default_rng(1), width + width // 4, height)
    photos = folder / "photos"
    photos.mkdir(parents=True)
    for index, left in enumerate((0, width // 4)):
        Image.fromarray(wide[:, left : left + width]).save(photos / f"{index}.png")
    photo_set = PhotoSet(photos, tuple(Photo(f"{i}.png", width, height, None, str(i)) for i in range(2)), ())
    workspace = SfmWorkspace(folder / "work", photo_set, CameraSettings())
    before = cpu_seconds()
    match_features(workspace, report=lambda done, message: None, should_stop=never_stop)
    return cpu_seconds() - before


def _sam_encode_seconds() -> float | None:
    """Return the CPU seconds of encoding a picture, or None if the model is missing."""
    from ...masks import load_sam
    from ...masks.settings import SAM_MODELS

    try:
        # On the CPU, whose speed it stands for; a graphics card would only encode.
        sam = load_sam(SAM_MODELS[0], may_use_gpu=False)
    except ModelFileError:
        return None
    picture = _texture(np.random.default_rng(2), 1024, 768)
    sam.encode(picture)  # the first picture is encoded twice if its features are compared
    before = cpu_seconds()
    sam.encode(picture)
    return cpu_seconds() - before
