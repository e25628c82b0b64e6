"""The look of a photo, measured while it is decoded: small enough to keep for every photo and to compare pairs.

`copies` finds the same shot in other pixels with it, `mask_pictures` pictures that are masks.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32, Pixels

_SIDE = 192
"""Longest side of the reduced picture in pixels."""
_CROP = 80
"""Side of each of the four crops in full resolution, in pixels."""
_SAMPLE_SIDE = 256
"""Longest side of the grid of pixels whose exact values are counted."""
GRAY_WEIGHTS = np.array([0.299, 0.587, 0.114], dtype=np.float32)
_CHROMA = 16
"""Largest difference between the channels of a grey pixel; JPEG changes them a little."""
_EXTREME = 32
"""A pixel is nearly black or white when its value is at most this far from 0 or from the brightest value."""
_N_COLOURS = 8
"""Number of the most frequent colours whose shares are kept: a mask has one per object."""


@dataclass(frozen=True)
class Look:
    """A photo for comparisons.

    Attributes
    ----------
    width, height : int
        Size of the photo in pixels.
    small : array of shape [h, w], uint8
        Brightness, with the longest side reduced to 192 pixels.
    detail : array of shape [2 c, 2 c], uint8
        Brightness of four crops of the photo in full resolution, which lie symmetrically: a photo that is rotated by a
        quarter turn has the same crops, rotated.
    gray_share : float
        Share of the pixels without colour.
    dark_share, bright_share : float
        Shares of the pixels that are nearly 0, and nearly as bright as the brightest.
    colour_shares : tuple of float
        Shares of the 8 most frequent exact colours, the largest first.
    taken : str or None
        Time of capture from EXIF, with its fraction of a second.
    encoding : str
        Equal for photos that the same program saved with the same settings.
    """

    width: int
    height: int
    small: Pixels
    detail: Pixels
    gray_share: float
    dark_share: float
    bright_share: float
    colour_shares: tuple[float, ...]
    taken: str | None
    encoding: str

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> Look:
        """Return the look that `LookBuilder.values` stored."""
        arrays = {name: _array_of(values[name]) for name in ("small", "detail")}
        return cls(**{**values, **arrays, "colour_shares": tuple(values["colour_shares"])})


class LookBuilder:
    """Measures a look while the photo is decoded from top to bottom.

    Parameters
    ----------
    width, height : int
        Size of the upright photo in pixels.
    step : int
        Side of the squares that the brightness given to `values` is averaged over, in pixels.
    """

    def __init__(self, width: int, height: int, step: int) -> None:
        self._size, self._step, self._top = (width, height), step, 0
        self._rows, self._columns = _crop_starts(height), _crop_starts(width)
        side = min(_CROP, height), min(_CROP, width)
        self._detail = np.zeros((2 * side[0], 2 * side[1]), np.uint8)
        self._side = side
        self._every = max(1, -(-max(width, height) // _SAMPLE_SIDE))
        self._sampled: list[NDArray[np.uint8]] = []

    def add(self, strip: NDArray[np.uint8]) -> None:
        """Measure the next rows, [h, width, 3]."""
        bottom = self._top + len(strip)
        high, wide = self._side
        for i, first_row in enumerate(self._rows):
            low, end = max(first_row, self._top), min(first_row + high, bottom)
            if low >= end:
                continue
            for j, column in enumerate(self._columns):
                gray = strip[low - self._top : end - self._top, column : column + wide] @ GRAY_WEIGHTS
                row = i * high + low - first_row
                self._detail[row : row + end - low, j * wide : (j + 1) * wide] = np.rint(gray)
        self._sampled.append(strip[-self._top % self._every :: self._every, :: self._every].reshape(-1, 3).copy())
        self._top = bottom

    def values(self, gray: Float32, *, taken: str | None, encoding: str) -> dict[str, Any]:
        """Return the look as JSON values.

        Parameters
        ----------
        gray : array of shape [height // step, width // step], float32
            Brightness of the photo, averaged over squares of `step` pixels.
        taken, encoding : str
            See `Look`.
        """
        width, height = self._size
        scale = min(1.0, _SIDE / max(width, height))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        small = area_reduced(gray, size, (width / self._step, height / self._step))
        pixels = np.concatenate(self._sampled)
        darkest, brightest = pixels.min(axis=1), pixels.max(axis=1)
        top = int(brightest.max(initial=1))
        near = min(_EXTREME, top // 4)
        codes = pixels.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
        counts = np.sort(np.unique(codes, return_counts=True)[1])[::-1][:_N_COLOURS]
        return {
            "width": width,
            "height": height,
            "small": _values_of(np.rint(small).astype(np.uint8)),
            "detail": _values_of(self._detail),
            "gray_share": float(np.mean(brightest - darkest <= _CHROMA)),
            "dark_share": float(np.mean(brightest <= near)),
            "bright_share": float(np.mean(darkest >= top - near)),
            "colour_shares": [float(count) / len(codes) for count in counts],
            "taken": taken,
            "encoding": encoding,
        }


def area_reduced(gray: Float32, size: tuple[int, int], covered: tuple[float, float] | None = None) -> Float32:
    """Return `gray` [h, w] reduced to `size` (width, height) by the mean over the area of each pixel.

    Parameters
    ----------
    gray : array of shape [h, w], float32
    size : (int, int)
    covered : (float, float), optional
        Width and height that the result covers, in pixels of `gray`; they may exceed it by less than a pixel. By
        default all of it.
    """
    wide, high = covered or (gray.shape[1], gray.shape[0])
    rows = _means_along_rows(gray.astype(np.float64), wide, size[0])
    return _means_along_rows(rows.T, high, size[1]).T.astype(np.float32)


def _means_along_rows(values: NDArray[np.float64], covered: float, n: int) -> NDArray[np.float64]:
    """Return the means of `n` equal parts of the first `covered` pixels of each row, which may be parts of pixels.

    From sums up to each edge: a product with a matrix would make each thread allocate buffers of 32 MB.
    """
    sums = np.cumsum(np.pad(values, ((0, 0), (1, 0))), axis=1)
    edges = np.minimum(np.linspace(0.0, covered, n + 1), values.shape[1])
    below = np.minimum(edges.astype(int), values.shape[1] - 1)
    at_edges = sums[:, below] + (edges - below) * values[:, below]
    return np.diff(at_edges, axis=1) / np.diff(edges)


def _crop_starts(n: int) -> tuple[int, int]:
    """Return where the two crops along a side of `n` pixels begin, at equal distances from its ends."""
    side = min(_CROP, n)
    start = max(0, (n // 2 - side) // 2)
    return start, n - start - side


def _values_of(array: Pixels) -> list[Any]:
    return [list(array.shape), base64.b64encode(array.tobytes()).decode("ascii")]


def _array_of(values: list[Any]) -> Pixels:
    shape, encoded = values
    return np.frombuffer(base64.b64decode(encoded), np.uint8).reshape(shape)
