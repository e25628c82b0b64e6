"""What detail is trained on: the parts of photos that show an object, and the windows of them that steps compare."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32, Mask, Pixels
from ..core.system import usable_cores
from ..scene import PinholeCamera

_COARSE = 0.25  # chosen on museum_room
"""Share of the steps, the first ones, that compare whole crops, in which far displacements are seen."""

_MIDDLE = 0.55
"""Share of the steps before which windows of large photos are those of the size of the crops' maps."""

_MUCH_LARGER = 2.0
"""Number of pixels, relative to that of the maps, from which on crops are compared at the size of the maps, too."""


@dataclass(frozen=True)
class DetailCrop:
    """The part of a photo that shows an object, [H, W], and maps of it, [h, w], which may be smaller.

    Attributes
    ----------
    photo : str
        Name of the photo.
    camera : PinholeCamera
        Camera of the part, of its pixels.
    pixels : array of shape [H, W, 3], uint8
    compared : array of shape [h, w], bool
        Valid pixels to which the object contributes, and a margin.
    inside : array of shape [h, w], bool
        Valid pixels that the object alone must show as the photo does.
    shown : array of shape [h, w], bool
        Valid pixels in which the object alone is compared with the photo, `inside` among them.
    judged : array of shape [h, w], bool
        Those of `shown` in which the object is not mostly what is left out of it: they decide.
    alpha : array of shape [h, w], float32
        Coverage that the object has alone.
    known : array of shape [h, w], bool
        Where `alpha` is known: nothing hides the object.
    gain : array of shape [3], float32
        Brightness of the photo relative to the scene.
    weight : float
        How often the photo is used, relative to others.
    """

    photo: str
    camera: PinholeCamera
    pixels: Pixels
    compared: Mask
    inside: Mask
    shown: Mask
    judged: Mask
    alpha: Float32
    known: Mask
    gain: Float32
    weight: float

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the pixels."""
        return self.camera.height, self.camera.width

    @functools.cached_property
    def _compared_places(self) -> NDArray[np.intp]:
        return np.flatnonzero(self.compared)

    def pixels_of(self, mask: Mask) -> float:
        """Return the number of the photo's pixels in one of the maps."""
        return float(mask.sum()) * (self.camera.width * self.camera.height) / mask.size

    def window(self, left: int, top: int, width: int, height: int) -> DetailCrop:
        """Return a part of the crop, whose maps are as large as its pixels."""
        camera = self.camera.part(left, top, width, height)
        rows, columns = slice(top, top + height), slice(left, left + width)
        if self.alpha.shape == self.shape:
            maps = {name: getattr(self, name)[rows, columns] for name in _MAPS}
        else:
            x, y = (self.alpha.shape[1 - axis] / self.shape[1 - axis] for axis in (0, 1))
            # The centre of pixel 0 of the window, in pixels of the maps.
            to_map = np.array([[x, 0, (left + 0.5) * x - 0.5], [0, y, (top + 0.5) * y - 0.5]])
            maps = {name: _cut(getattr(self, name), to_map, (width, height)) for name in _MAPS}
        return replace(self, camera=camera, pixels=self.pixels[rows, columns], **maps)

    def reduced(self, max_pixels: int) -> DetailCrop:
        """Return the crop with at most `max_pixels`, rounded, and maps of this size."""
        height, width = self.shape
        scale = math.sqrt(max_pixels / (width * height))
        if scale >= 1 and self.alpha.shape == self.shape:
            return self
        size = (width, height) if scale >= 1 else (max(8, round(width * scale)), max(8, round(height * scale)))
        arrays = {}
        for name in ("pixels", *_MAPS):
            values = getattr(self, name)
            source = values.view(np.uint8) * np.uint8(255) if values.dtype == bool else values
            smaller = cv2.resize(source, size, interpolation=cv2.INTER_AREA)
            # All pixels of a mask that are averaged have to belong to it.
            arrays[name] = smaller == 255 if values.dtype == bool else smaller
        return replace(self, **arrays, camera=self.camera.resized(*size))

    def random_window(self, n_pixels: int, random: np.random.Generator) -> DetailCrop:
        """Return a window of about `n_pixels` around a random pixel to which the object contributes."""
        height, width = self.shape
        if width * height <= n_pixels or not len(self._compared_places):
            return self.reduced(width * height)
        side = math.sqrt(n_pixels)
        w = min(width, round(max(side, n_pixels / height)))
        h = min(height, round(max(side, n_pixels / width)))
        map_height, map_width = self.alpha.shape
        y, x = divmod(int(self._compared_places[random.integers(len(self._compared_places))]), map_width)
        if (map_height, map_width) != self.shape:
            y, x = int((y + random.random()) * height / map_height), int((x + random.random()) * width / map_width)
        return self.window(min(max(0, x - w // 2), width - w), min(max(0, y - h // 2), height - h), w, h)


_MAPS = ("compared", "inside", "shown", "judged", "alpha", "known")


def _cut(values: NDArray[Any], to_map: NDArray[np.float64], size: tuple[int, int]) -> NDArray[Any]:
    """Return the window `size` of a map: coverage is interpolated, and masks are those of the nearest pixel."""
    flags = cv2.WARP_INVERSE_MAP | (cv2.INTER_NEAREST if values.dtype == bool else cv2.INTER_LINEAR)
    source = values.view(np.uint8) if values.dtype == bool else values
    cut = cv2.warpAffine(source, to_map, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return cut.view(bool) if values.dtype == bool else cut


@dataclass(frozen=True)
class DetailPlan:
    """How much is trained.

    Attributes
    ----------
    steps : int
    max_gaussians : int
        Gaussians of the object at the end at most.
    window_pixels : int
        Pixels of a crop that a step compares: the whole crop, reduced, or a window of it. It bounds the time of a step.
    """

    steps: int
    max_gaussians: int
    window_pixels: int = 160 * 160

    @property
    def n_compared(self) -> float:
        """Pixels that all windows of the steps have together."""
        return (1 - _COARSE) * self.steps * self.window_pixels


class Levels:
    """Crops at the sizes that the steps compare, and the draw of each step's window, the same on every device.

    Parameters
    ----------
    crops : sequence of DetailCrop
        At least one.

    Notes
    -----
    First whole crops, reduced; then windows of crops as large as their maps; then windows at the photo's own size.
    """

    def __init__(self, crops: Sequence[DetailCrop], plan: DetailPlan) -> None:
        self._crops, self._plan = crops, plan
        with ThreadPoolExecutor(len(usable_cores())) as pool:
            self._coarse = list(pool.map(lambda crop: crop.reduced(plan.window_pixels), crops))
            self._middle = list(pool.map(_as_large_as_its_maps, crops))
        weights = np.array([crop.weight for crop in crops])
        self._weights = weights / weights.sum()
        self._random = np.random.default_rng(0)

    def draw(self, step: int) -> DetailCrop:
        """Return what step number `step` compares; the steps are to be drawn in their order."""
        index = int(self._random.choice(len(self._crops), p=self._weights))
        if step < _COARSE * self._plan.steps:
            return self._coarse[index]
        crops = self._middle if step < _MIDDLE * self._plan.steps else self._crops
        return crops[index].random_window(self._plan.window_pixels, self._random)


def _as_large_as_its_maps(crop: DetailCrop) -> DetailCrop:
    """Return the crop at the size of its maps, or as it is where it is little larger."""
    return crop.reduced(crop.alpha.size) if math.prod(crop.shape) > _MUCH_LARGER * crop.alpha.size else crop


def tiles(crop: DetailCrop, max_pixels: int, side: int = 384) -> list[DetailCrop]:
    """Return windows of a crop that cover it, or as many of them, evenly spread, as have `max_pixels` together."""
    height, width = crop.shape
    places = [(left, top) for top in range(0, height, side) for left in range(0, width, side)]
    n_kept = min(len(places), max(1, max_pixels // side**2))
    kept = [places[int((i + 0.5) * len(places) / n_kept)] for i in range(n_kept)]
    windows = (crop.window(x, y, min(side, width - x), min(side, height - y)) for x, y in kept)
    return [window for window in windows if window.shown.any()]
