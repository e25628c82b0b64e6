"""Windows of several sizes in a photo without segments: squares, or those in which the classifier sees classes.

The classifier's head averages over cells and applies a linear layer. The logits of any window are therefore the mean of
its cells in the class map, and one pass of the network per size replaces about a thousand crops.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch.nn import functional

from ...core.arrays import Float32, Pixels
from .crops import Box
from .efficientnet import INPUT_SIDE, EfficientNetLite2

# A window of this many cells covers about the area that the network saw in training (260 pixels are 8.1 cells).
_WINDOW_CELLS = 7  # chosen on museum_room
_CELL_PIXELS = 32
# Scales at which the photo is classified, in windows along its longest side.
_SCALES = (1.0, 2.0, 3.2, 5.0)  # chosen on museum_room
_MAX_OVERLAP = 0.3  # chosen on museum_room
_MAX_WINDOWS = 12  # chosen on museum_room
# Cells of a window whose class map value is at least this fraction of the window's maximum belong to the object.
_MIN_ACTIVATION = 0.35  # chosen on museum_room
_SQUARES = (1, 2, 3, 5)
"""Squares along the shorter side of a photo; the next begins in the middle of one."""


@dataclass(frozen=True)
class Window:
    """A box in a photo that probably shows one of several classes.

    Attributes
    ----------
    box : tuple of 4 float
        x0, y0, x1, y1 in photo pixels.
    probability : float
        Weighted sum of the probabilities of the classes.
    class_index : int
        The most probable of the classes.
    """

    box: tuple[float, float, float, float]
    probability: float
    class_index: int


def find_windows(classifier: EfficientNetLite2, pixels: Pixels, class_weights: dict[int, float]) -> list[Window]:
    """Return up to 12 boxes with a high probability of the classes, best first, with little overlap.

    Parameters
    ----------
    pixels : array of shape [H, W, 3], uint8, sRGB
    class_weights : dict of int to float
        Class index to weight.
    """
    candidates = [
        window for n_windows in _SCALES for window in _find_at_scale(classifier, pixels, class_weights, n_windows)
    ]
    candidates.sort(key=lambda window: -window.probability)
    kept: list[Window] = []
    for window in candidates:
        if len(kept) < _MAX_WINDOWS and all(_overlap(window.box, other.box) <= _MAX_OVERLAP for other in kept):
            kept.append(window)
    return kept


def _find_at_scale(
    classifier: EfficientNetLite2, pixels: Pixels, class_weights: dict[int, float], n_windows: float
) -> list[Window]:
    """Return the local maxima of the class probability with `n_windows` windows along the longest side."""
    height, width = pixels.shape[:2]
    scale = n_windows * INPUT_SIDE / max(height, width)
    shape = (max(_CELL_PIXELS, round(width * scale)), max(_CELL_PIXELS, round(height * scale)))
    resized = cv2.resize(pixels, shape, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    picture = torch.from_numpy(resized).permute(2, 0, 1)[None].float()
    cells = classifier.class_map(classifier.features(picture))
    window = (min(_WINDOW_CELLS, cells.shape[2]), min(_WINDOW_CELLS, cells.shape[3]))
    logits = functional.avg_pool2d(cells, window, stride=1)[0]
    probabilities = logits.softmax(dim=0).numpy()
    classes = np.array(list(class_weights))
    combined = (probabilities[classes] * np.array(list(class_weights.values()), np.float32)[:, None, None]).sum(axis=0)
    best = classes[probabilities[classes].argmax(axis=0)]
    pooled = torch.from_numpy(combined)[None, None]
    peaks = np.argwhere((pooled == functional.max_pool2d(pooled, 3, stride=1, padding=1))[0, 0].numpy())
    pixels_per_cell = (width * _CELL_PIXELS / shape[0], height * _CELL_PIXELS / shape[1])
    windows = []
    for row, column in peaks:
        class_index = int(best[row, column])
        window_cells = cells[0, class_index, row : row + window[0], column : column + window[1]].numpy()
        x0, y0, x1, y1 = _active_box(window_cells)
        box = (
            (column + x0) * pixels_per_cell[0],
            (row + y0) * pixels_per_cell[1],
            min(float(width), (column + x1) * pixels_per_cell[0]),
            min(float(height), (row + y1) * pixels_per_cell[1]),
        )
        windows.append(
            Window(
                (float(box[0]), float(box[1]), float(box[2]), float(box[3])), float(combined[row, column]), class_index
            )
        )
    return windows


def _active_box(class_map: Float32) -> tuple[int, int, int, int]:
    """Return the box x0, y0, x1, y1 in cells around the connected component of active cells with the maximum."""
    active = (class_map >= _MIN_ACTIVATION * class_map.max()).astype(np.uint8)
    _, components, statistics, _ = cv2.connectedComponentsWithStats(active, connectivity=8)
    component = int(components.flat[int(class_map.argmax())])
    x, y, w, h = (int(value) for value in statistics[component, :4])
    return x, y, x + w, y + h


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> float:
    """Return the intersection over the smaller box, 1 if one window is inside the other."""
    width = max(0.0, min(a[2], b[2]) - max(a[0], b[0]))
    height = max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    smaller = min((a[2] - a[0]) * (a[3] - a[1]), (b[2] - b[0]) * (b[3] - b[1]))
    return width * height / smaller if smaller > 0 else 0.0


def square_windows(height: int, width: int) -> list[Box]:
    """Return squares of several sizes that cover a photo."""
    boxes = []
    for count in _SQUARES:
        side = min(height, width) / count
        rows, columns = (np.arange(0, size - side + 1e-6, side / 2) for size in (height, width))
        boxes += [(float(x), float(y), float(x + side), float(y + side)) for y in rows for x in columns]
    return boxes
