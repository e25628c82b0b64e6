"""Measurement of the error on test and validation photos, the clock for it, and the preview picture."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from ..core.files import atomic_write
from ..core.system import usable_cores
from ..rasterizer.settings import Backend
from .losses import ssim
from .parameters import render
from .views import Level, TrainingView

_Result = TypeVar("_Result")

MAX_MEASURED_PHOTOS = 8
"""Largest number of photos, evenly spaced, that the error is measured on."""

_MEASURED_TOGETHER = 4
"""Pictures that are compared at the same time. One of 1600 x 1200 pixels takes a quarter of a GB, mostly float64."""

MIN_SQUARED_ERROR = 1e-10
"""Smallest mean squared error, which limits the PSNR to 100 dB. A photo of 8 bits is accurate to 59 dB."""


@dataclass(frozen=True)
class Quality:
    """Similarity of a picture to a photo: PSNR in dB, SSIM, and mean absolute difference of values in [0, 1]."""

    psnr: float
    ssim: float
    l1: float


@dataclass(frozen=True)
class CurvePoint:
    """One measurement of a training run, on the test photos or on the validation photos.

    Attributes
    ----------
    step : int
        Finished training steps.
    wall_seconds, cpu_seconds : float
        Time spent on training so far, over all resumed runs, without the measurements.
    psnr : float
        Mean over the measured photos, dB.
    ssim, l1 : float
        Means over the measured photos.
    n_gaussians : int
    """

    step: int
    wall_seconds: float
    cpu_seconds: float
    psnr: float
    ssim: float
    l1: float
    n_gaussians: int


class Clock(AbstractContextManager["Clock"]):
    """Wall and CPU seconds spent inside its ``with`` blocks.

    Parameters
    ----------
    wall, cpu : float
        Seconds spent before.
    """

    def __init__(self, wall: float = 0.0, cpu: float = 0.0) -> None:
        self._spent = [wall, cpu]
        self._started: tuple[float, float] | None = None

    def __enter__(self) -> Clock:
        self._started = (time.perf_counter(), time.process_time())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._spent = [self.wall, self.cpu]
        self._started = None

    @property
    def wall(self) -> float:
        """Wall seconds spent so far."""
        return self._spent[0] + (time.perf_counter() - self._started[0] if self._started else 0.0)

    @property
    def cpu(self) -> float:
        """CPU seconds of this process spent so far."""
        return self._spent[1] + (time.process_time() - self._started[1] if self._started else 0.0)


def image_quality(image: torch.Tensor, pixels: NDArray[np.uint8], valid: NDArray[np.bool_] | None = None) -> Quality:
    """Return PSNR, SSIM and L1 of `image` against a photo.

    Parameters
    ----------
    image : tensor of shape [H, W, 3], float32
        Rendered picture; it is clamped to [0, 1].
    pixels : array of shape [H, W, 3], uint8
    valid : bool array of shape [H, W], optional
        Pixels that are compared; all by default.
    """
    image = image.clamp(0.0, 1.0)
    target = torch.from_numpy(pixels).float().div_(255.0)
    compared = None if valid is None else torch.from_numpy(valid)
    difference = (image - target).double()
    difference = difference if compared is None else difference[compared]
    psnr = -10.0 * math.log10(max(float(difference.square().mean()), MIN_SQUARED_ERROR))
    return Quality(psnr, ssim(image, target, valid=compared), float(difference.abs().mean()))


def render_picture(values: dict[str, torch.Tensor], level: Level, *, backend: Backend, sh_degree: int) -> torch.Tensor:
    """Render the Gaussians over black from the camera of `level`, [h, w, 3] in [0, 1], without gradients."""
    with torch.no_grad():
        return render(values, level.camera, backend=backend, sh_degree=sh_degree).image[..., :3].clamp(0.0, 1.0)


def measure(picture: Callable[[Level], torch.Tensor], levels: Sequence[Level]) -> Quality:
    """Return the mean quality over the photos in `levels`; `picture` renders one as `render_picture` does.

    One picture is rendered after the other; others are compared with their photos at the same time, in threads.
    """
    return mean_quality(
        in_threads(functools.partial(image_quality, picture(level), level.pixels, level.valid) for level in levels)
    )


def in_threads(works: Iterable[Callable[[], _Result]]) -> list[_Result]:
    """Return what each of several functions returns, called in threads, while the next functions are being made."""
    with ThreadPoolExecutor(min(_MEASURED_TOGETHER, len(usable_cores()))) as threads:
        return [future.result() for future in [threads.submit(work) for work in works]]


def mean_quality(qualities: Sequence[Quality]) -> Quality:
    """Return the mean of each figure."""
    return Quality(
        float(np.mean([q.psnr for q in qualities])),
        float(np.mean([q.ssim for q in qualities])),
        float(np.mean([q.l1 for q in qualities])),
    )


def mean_color(views: Sequence[TrainingView]) -> NDArray[np.float64]:
    """Return the mean colour of the photos, shape [3], in [0, 1]."""
    means = in_threads(functools.partial(_mean_of_valid, view) for view in views)
    return np.asarray(np.mean(means, axis=0) / 255.0)


def _mean_of_valid(view: TrainingView) -> NDArray[np.float64]:
    return np.asarray(_valid_pixels(view.pixels, view.valid).mean(axis=0))


def flat_psnr(color: NDArray[np.float64], levels: Sequence[Level]) -> float:
    """Return the mean PSNR in dB of pictures of nothing but `color`, shape [3] in [0, 1], on the photos in `levels`."""
    squares = [np.square(_valid_pixels(level.pixels, level.valid) / 255.0 - color).mean() for level in levels]
    return float(np.mean([-10.0 * math.log10(max(float(square), MIN_SQUARED_ERROR)) for square in squares]))


def _valid_pixels(pixels: NDArray[np.uint8], valid: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Return the valid pixels, [P, 3]."""
    return pixels.reshape(-1, 3) if valid is None else pixels[valid]


def write_picture(path: Path, image: torch.Tensor) -> None:
    """Write `image` [h, w, 3] in [0, 1] as an 8-bit PNG, atomically."""
    with atomic_write(path) as stream:
        Image.fromarray((image * 255.0).round().to(torch.uint8).numpy()).save(stream, format="PNG")
