"""Training curve, PSNR against run time: reads it from a project and draws it as a small image. No bpy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float32
from ...engine.core.errors import HeritageError
from ...engine.core.files import read_after_change
from ...engine.project.folder import PROJECT_FILE, ProjectFolder

Point = tuple[float, float]
"""Wall seconds of training, and PSNR of the test photos in dB."""

_LINE = np.array([0.92, 0.49, 0.20], np.float32)
_GRID = np.array([0.55, 0.55, 0.55], np.float32)
_LEFT, _BOTTOM, _BORDER = 26, 16, 8
"""Margins of the plot in pixels. Those on the left and at the bottom hold the numbers."""
_SIZE = 256, 160
"""Width and height of the image in pixels."""
_SCALE = 2
"""Image pixels for each pixel of a glyph."""
_MAX_POINTS = 256
_MIN_SECONDS, _MAX_SECONDS = 1e-6, 1e9
_MAX_PSNR = 1000.0
"""Limits of what is drawn, so that the number of grid lines stays small."""
_GLYPHS = {
    "0": "75557", "1": "26227", "2": "71747", "3": "71717", "4": "55711", "5": "74717", "6": "74757", "7": "71111",
    "8": "75757", "9": "75717", "k": "45655",
}  # fmt: skip
"""Five rows from the top, each an octal digit whose bits are three pixels."""


@read_after_change(PROJECT_FILE)
def stored_curve(project: Path) -> tuple[Point, ...]:
    """Return the curve of the finished training in `project`; empty when there is none or it cannot be read."""
    try:
        record = ProjectFolder.open_existing(project).stage_record("training") or {}
        points = record["figures"]["curve"]
        return thinned(
            [(float(point["wall_seconds"]), float(point["psnr"])) for point in points if point["psnr"] is not None]
        )
    except (HeritageError, KeyError, TypeError, ValueError):
        # The panel then draws no curve. The engine reports an error when it uses the project.
        return ()


def thinned(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return at most `_MAX_POINTS` of `points`, evenly chosen, the last among them; a panel shows no more."""
    if len(points) <= _MAX_POINTS:
        return tuple(points)
    return tuple(points[number] for number in np.linspace(0, len(points) - 1, _MAX_POINTS).astype(int))


def curve_picture(points: Sequence[Point]) -> Float32 | None:
    """Return an image of PSNR against seconds, for a panel.

    Parameters
    ----------
    points : sequence of (float, float)
        Points that no training has are ignored: values that are not finite, seconds that are not positive.

    Returns
    -------
    array of shape [160, 256, 4], float32, or None
        RGBA with the bottom row first, as in Blender; None for fewer than two points.
    """
    usable = sorted((s, p) for s, p in thinned(points) if _MIN_SECONDS < s < _MAX_SECONDS and abs(p) < _MAX_PSNR)
    if len(usable) < 2 or usable[0][0] == usable[-1][0]:
        return None
    seconds, psnr = np.array(usable).T
    width, height = _SIZE
    x_axis = _Axis(math.log10(seconds[0]), math.log10(seconds[-1]), _LEFT, width - _BORDER)
    # At least 1 dB, so that the noise of a flat curve does not look like progress.
    y_axis = _Axis(psnr.min(), max(psnr.max(), psnr.min() + 1.0), _BOTTOM, height - _BORDER)
    picture = np.zeros((height, width, 4), np.float32)
    for second in _round_seconds(seconds[0], seconds[-1]):
        column = round(x_axis.at(math.log10(second)))
        _paint(picture, np.s_[_BOTTOM:, column], _GRID, 0.35)
        text = f"{second // 1000}k" if second >= 1000 else str(second)
        _write(picture, text, column - _width(text) // 2, _BOTTOM - 13)
    for value in _round_values(y_axis.low, y_axis.high):
        row = round(y_axis.at(value))
        _paint(picture, np.s_[row, _LEFT:], _GRID, 0.35)
        _write(picture, str(value), _LEFT - 4 - _width(str(value)), row - 5)
    corners = np.stack([x_axis.at(np.log10(seconds)), y_axis.at(psnr)], axis=1)
    distance = _distance_to_line(corners, width, height)
    _paint(picture, np.s_[:, :], _LINE, np.clip(2.0 - distance, 0.0, 1.0))
    return picture


class _Axis:
    """Linear map from values to pixels."""

    def __init__(self, low: float, high: float, first: float, last: float) -> None:
        self.low, self.high, self._first, self._last = float(low), float(high), first, last

    def at(self, value: Any) -> Any:
        """Return the pixel of a value, or of each value of an array."""
        return self._first + (value - self.low) / (self.high - self.low) * (self._last - self._first)


def _round_seconds(first: float, last: float) -> Iterator[int]:
    """Yield 1, 10, 100 ... between `first` and `last`, and also their multiples by 2 and 5 when there are few."""
    steps = (1,) if last / first > 300 else (1, 2, 5)
    for power in range(max(0, math.floor(math.log10(first))), math.floor(math.log10(last)) + 1):
        yield from (step * 10**power for step in steps if first <= step * 10**power <= last)


def _round_values(low: float, high: float) -> range:
    step = next(step for step in (1, 2, 5, 10, 20, 50, 100, 200, 500) if (high - low) / step <= 5 or step == 500)
    return range(math.ceil(low / step) * step, math.floor(high) + 1, step)


def _width(text: str) -> int:
    return (4 * len(text) - 1) * _SCALE


def _write(picture: Float32, text: str, x: int, y: int) -> None:
    """Write `text` with its lower left corner at (x, y), without the glyphs that would be outside the image."""
    x = min(x, picture.shape[1] - _width(text))
    for number, character in enumerate(text):
        bits = np.array([[int(row) >> shift & 1 for shift in (2, 1, 0)] for row in reversed(_GLYPHS[character])])
        left = x + number * 4 * _SCALE
        if left < 0 or y < 0 or y + 5 * _SCALE > picture.shape[0]:
            continue
        part = np.s_[y : y + 5 * _SCALE, left : left + 3 * _SCALE]
        _paint(picture, part, _GRID, np.kron(bits, np.ones((_SCALE, _SCALE))))


def _paint(picture: Float32, part: Any, color: Float32, alpha: float | NDArray[np.floating]) -> None:
    """Blend `color` over the slice `part` of the picture. Alpha is straight, not premultiplied."""
    below = picture[part]
    cover = np.broadcast_to(np.asarray(alpha, np.float32), below.shape[:-1])[..., None]
    total = cover + below[..., 3:] * (1 - cover)
    mixed = (color * cover + below[..., :3] * below[..., 3:] * (1 - cover)) / np.maximum(total, 1e-6)
    picture[part] = np.concatenate([mixed, total], axis=-1)


def _distance_to_line(corners: NDArray[np.float64], width: int, height: int) -> NDArray[np.float64]:
    """Return the distance of each pixel centre from the polyline through `corners` [P, 2], shape [height, width]."""
    centers = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    nearest = np.full((height, width), np.inf)
    for start, end in zip(corners[:-1], corners[1:], strict=True):
        step = end - start
        share = np.clip((centers - start) @ step / max(step @ step, 1e-12), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(centers - start - share[..., None] * step, axis=-1))
    return nearest
