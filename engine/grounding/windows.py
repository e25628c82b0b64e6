"""Finds classes in a photo without segments: windows of several sizes over the feature map, boxes from class maps.

The classifier's head is a mean over cells and a linear layer, so the class map gives the logits of any window as the
mean of its cells: one pass of the network for each size replaces a thousand crops.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from .efficientnet import INPUT_SIDE, EfficientNetLite2

__all__ = ["Window", "find_windows"]

# Windows of this many cells see about what the network saw in training (260 pixels are 8.1 cells).
_CELLS = 7
_CELL = 32
# The photo's longest side in windows: an object fills a half, a third or a fifth of it.
_SIZES = (1.0, 2.0, 3.2, 5.0)
_MAX_OVERLAP = 0.3
_MAX_FOUND = 12
# Share of the class map's highest value in the window above which a cell belongs to the object.
_INSIDE = 0.35


@dataclass(frozen=True)
class Window:
    """A box x0, y0, x1, y1 in photo pixels, the class seen most in it and the probability of all classes meant."""

    box: tuple[float, float, float, float]
    probability: float
    number: int


def find_windows(classifier: EfficientNetLite2, pixels: NDArray[np.uint8], weights: dict[int, float]) -> list[Window]:
    """Return boxes where the classes of `weights` are likely, best first, at most 12 and not overlapping much.

    Parameters
    ----------
    classifier : EfficientNetLite2
    pixels : array of shape [H, W, 3], uint8, sRGB
    weights : dict of int to float
        Class numbers and what a hit on each counts.
    """
    candidates = [window for size in _SIZES for window in _of_size(classifier, pixels, weights, size)]
    candidates.sort(key=lambda window: -window.probability)
    kept: list[Window] = []
    for window in candidates:
        if len(kept) < _MAX_FOUND and all(_overlap(window.box, other.box) <= _MAX_OVERLAP for other in kept):
            kept.append(window)
    return kept


def _of_size(
    classifier: EfficientNetLite2, pixels: NDArray[np.uint8], weights: dict[int, float], size: float
) -> list[Window]:
    height, width = pixels.shape[:2]
    scale = size * INPUT_SIDE / max(height, width)
    shape = (max(_CELL, round(width * scale)), max(_CELL, round(height * scale)))
    resized = cv2.resize(pixels, shape, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    picture = torch.from_numpy(resized).permute(2, 0, 1)[None].float()
    cells = classifier.class_map(classifier.features(picture))
    window = (min(_CELLS, cells.shape[2]), min(_CELLS, cells.shape[3]))
    logits = functional.avg_pool2d(cells, window, stride=1)[0]
    probabilities = logits.softmax(dim=0).numpy()
    numbers = np.array(list(weights))
    meant = (probabilities[numbers] * np.array(list(weights.values()), np.float32)[:, None, None]).sum(axis=0)
    best = numbers[probabilities[numbers].argmax(axis=0)]
    pooled = torch.from_numpy(meant)[None, None]
    peaks = np.argwhere((pooled == functional.max_pool2d(pooled, 3, stride=1, padding=1))[0, 0].numpy())
    pixels_per_cell = (width * _CELL / shape[0], height * _CELL / shape[1])
    found = []
    for row, column in peaks:
        number = int(best[row, column])
        inside = cells[0, number, row : row + window[0], column : column + window[1]].numpy()
        x0, y0, x1, y1 = _tight(inside)
        box = (
            (column + x0) * pixels_per_cell[0],
            (row + y0) * pixels_per_cell[1],
            min(float(width), (column + x1) * pixels_per_cell[0]),
            min(float(height), (row + y1) * pixels_per_cell[1]),
        )
        found.append(
            Window((float(box[0]), float(box[1]), float(box[2]), float(box[3])), float(meant[row, column]), number)
        )
    return found


def _tight(class_map: NDArray[np.float32]) -> tuple[int, int, int, int]:
    """Return the box x0, y0, x1, y1 in cells around the connected active cells that hold the highest one."""
    active = (class_map >= _INSIDE * class_map.max()).astype(np.uint8)
    _, components, statistics, _ = cv2.connectedComponentsWithStats(active, connectivity=8)
    component = int(components.flat[int(class_map.argmax())])
    x, y, w, h = (int(value) for value in statistics[component, :4])
    return x, y, x + w, y + h


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> float:
    """Intersection over the smaller box: a window inside a larger one is the same find."""
    across = max(0.0, min(a[2], b[2]) - max(a[0], b[0]))
    down = max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    smaller = min((a[2] - a[0]) * (a[3] - a[1]), (b[2] - b[0]) * (b[3] - b[1]))
    return across * down / smaller if smaller > 0 else 0.0
