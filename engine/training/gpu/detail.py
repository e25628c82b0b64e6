"""Detail on a graphics card: object and scene stay there, and the windows of photos are copied to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...core.arrays import Float32
from ...rasterizer.gpu import FrameSize, Gpu, camera_values
from ...rasterizer.settings import RasterSettings
from ...scene import Gaussians, PinholeCamera
from ..densify import split
from ..detail_crops import DetailCrop, DetailPlan
from ..detail_rules import LEARNING_RATES, ObjectLimits, median_scale, reach_of, rows_in_window
from ..losses import GpuExposures
from ..parameters import Parameters
from ..population import Population
from .detail_frame import DetailFrame, Window, packed_window
from .parameters import GpuParameters
from .settings import StepSettings
from .steps import told_how_to_continue
from .trainer import GpuTrainer
from .training_frame import PhotoLoss, TrainingFrame

_ADVICE = "nothing of this object was stored. Run again, or add `--device cpu` to detail it on the processor."

_BATCH = 64
"""Steps that are queued together: a cancel waits for them."""

_ERROR_WINDOWS = 20
"""Windows, the last ones, whose errors decide where Gaussians are split."""

_SIDE = 32
"""Sides of pictures are multiples of this, so that there are few sizes, each of which has dispatches of its own."""

_MIN_GAIN = 1e-6


@dataclass(frozen=True)
class _Step:
    """A step of detail, with the names of `StepPlan` that the trainer reads."""

    window: Window
    learning_rates: Mapping[str, float]
    sh_degree: int
    exposure_rate: None = None
    limits: bool = True


class _DetailTrainer(GpuTrainer):
    """Steps of `GpuTrainer` that are those of detail."""

    def __init__(
        self, gpu: Gpu, parameters: GpuParameters, settings: StepSettings, exposures: GpuExposures, limits: Float32,
        max_gaussians: int,
    ) -> None:  # fmt: skip
        super().__init__(gpu, parameters, settings, exposures=exposures, max_gaussians=max_gaussians)
        self._object_limits = limits

    def _check(self, plan: Any) -> None:
        """Windows are made to fit."""

    def _queue(self, plan: Any, index: int, queued: Mapping[str, int]) -> None:
        window: Window = plan.window
        frame = self._frame(window.camera)
        assert isinstance(frame, DetailFrame)
        frame.set_camera_values(camera_values(window.camera, self.settings.raster), plan.sh_degree)
        frame.set_window(window)
        self._set_optimiser(frame, plan, PhotoLoss(None, 1, 0.0, view=window.view), index, queued)
        frame.step()

    def _make_frame(self, camera: PinholeCamera, *, with_features: bool) -> None:
        parameters, width, height = self.parameters, camera.width, camera.height
        size = FrameSize(parameters.n, parameters.n_sh, 0, width, height, self._capacity, room=parameters.room)
        frame: TrainingFrame = DetailFrame(
            self.gpu, size, parameters, self.exposures, self._status, self._pool, timings=self._timings,
            limits=self._object_limits,
        )  # fmt: skip
        self._frames[width, height, with_features] = frame


class GpuDetailSteps:
    """See `engine.training.detail.DetailSteps`.

    Raises
    ------
    EnvironmentProblem
        If there is no card, it fails its self-test, its memory is full, or it stops working.
    """

    @told_how_to_continue(_ADVICE)
    def __init__(self, gaussians: Gaussians, others: Gaussians, crops: Sequence[DetailCrop], plan: DetailPlan) -> None:
        from ...rasterizer.gpu import open_gpu

        gpu = open_gpu()
        shown = _in_crops(others, crops)
        own, rest = (_values(one) for one in (gaussians, others[shown]))
        self._n_frozen, self._n_own = len(shown), len(gaussians)
        self._names, self._degree = tuple(own), gaussians.sh_degree
        values = {name: np.concatenate([rest[name], own[name]]) for name in own}
        parameters = GpuParameters(gpu, values, n_background=self._n_frozen)
        self._views = {crop.photo: number for number, crop in enumerate(crops)}
        gains = np.stack([np.log(np.maximum(crop.gain, _MIN_GAIN)) for crop in crops]).astype(np.float32)
        limits = ObjectLimits.of(gaussians)
        self._trainer = _DetailTrainer(
            gpu, parameters, StepSettings(raster=RasterSettings(antialiased=gaussians.antialiased)),
            GpuExposures(gpu, gains), np.array(limits.values, np.float32), self._n_frozen + plan.max_gaussians,
        )  # fmt: skip
        self._parents = np.arange(self._n_own)
        self._waiting: list[Future[_Step]] = []
        # While steps are queued, those after them are drawn and packed.
        self._packing, self._queueing = ThreadPoolExecutor(1), ThreadPoolExecutor(1)
        self._queued: Future[list[float]] | None = None
        self._seen: deque[DetailCrop] = deque(maxlen=_ERROR_WINDOWS)
        self._generator = torch.Generator().manual_seed(0)
        self._median_scale = median_scale(torch.from_numpy(gaussians.log_scales))

    def __len__(self) -> int:
        return self._trainer.parameters.n - self._n_frozen

    def step(self, crop: DetailCrop, factor: float) -> None:
        """See `DetailSteps`."""
        rates = {name: factor * LEARNING_RATES[name] for name in self._names}
        rates["means"] *= self._median_scale
        self._seen.append(crop)
        self._waiting.append(self._packing.submit(self._packed, crop, rates))
        if len(self._waiting) == _BATCH:
            self._queue()

    def _packed(self, crop: DetailCrop, rates: Mapping[str, float]) -> _Step:
        window = packed_window(crop, _padded(crop.camera), self._views[crop.photo])
        return _Step(window, rates, self._degree)

    @told_how_to_continue(_ADVICE)
    def _queue(self) -> None:
        """Let the steps that wait be made, when those before them are."""
        if self._queued is not None:
            self._queued.result()
        steps, self._waiting = self._waiting, []
        self._queued = self._queueing.submit(self._trainer.steps, (step.result() for step in steps))  # type: ignore[arg-type, misc]

    @told_how_to_continue(_ADVICE)
    def _flush(self) -> None:
        """Wait until all steps are made."""
        self._queue()
        assert self._queued is not None
        self._queued.result()

    @told_how_to_continue(_ADVICE)
    def grow(self, n_new: int) -> None:
        """See `DetailSteps`."""
        self._flush()
        geometry = self._trainer.geometry()
        population = Population(geometry, n_background=self._n_frozen)
        split(population, self._errors(), n_new, generator=self._generator)
        sources = population.values["sources"]
        if bool(population.fresh.any()):
            self._trainer.rearrange(population.geometry, sources, population.fresh)
            self._parents = self._parents[sources.numpy()[self._n_frozen :] - self._n_frozen]
        self._median_scale = median_scale(population.values["log_scales"][self._n_frozen :])

    def _errors(self) -> torch.Tensor:
        """Return the errors of the last windows in the pixels of each Gaussian, [N]."""
        numbers = []
        for crop in self._seen:
            camera = _padded(crop.camera)
            pixels = np.zeros((camera.height, camera.width, 3), np.uint8)
            valid = np.zeros(pixels.shape[:2], bool)
            height, width = crop.shape
            # Errors are those of the picture without the photo's brightness.
            plain = np.clip(crop.pixels / np.maximum(crop.gain, _MIN_GAIN), 0, 255)
            pixels[:height, :width], valid[:height, :width] = plain, crop.compared
            numbers.append(self._trainer.add_photo(camera, pixels, valid=valid))
        errors = self._trainer.gaussian_errors(numbers, self._degree)
        for number in numbers:
            self._trainer.free_photo(number)
        return errors

    @told_how_to_continue(_ADVICE)
    def result(self) -> tuple[Gaussians, NDArray[np.int64]]:
        """See `DetailSteps`."""
        self._flush()
        self._packing.shutdown()
        self._queueing.shutdown()
        values, moments = self._trainer.download()
        own = {name: value[self._n_frozen :] for name, value in values.items()}
        return Parameters(own, moments).to_gaussians(unit_features=False), self._parents


def _values(gaussians: Gaussians) -> dict[str, Float32]:
    parameters = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False)
    return {name: value.numpy() for name, value in parameters.values.items()}


def _in_crops(gaussians: Gaussians, crops: Iterable[DetailCrop]) -> NDArray[np.intp]:
    """Return the Gaussians that reach into any of the crops."""
    found = np.zeros(len(gaussians), bool)
    reach = reach_of(gaussians.log_scales)
    for crop in crops:
        found[rows_in_window(gaussians.means, reach, crop.camera)] = True
    return np.flatnonzero(found)


def _padded(camera: PinholeCamera) -> PinholeCamera:
    """Return the camera of a picture that begins as that of `camera` and has one of few sizes."""
    width, height = (-(-side // _SIDE) * _SIDE for side in (camera.width, camera.height))
    return replace(camera, width=width, height=height)
