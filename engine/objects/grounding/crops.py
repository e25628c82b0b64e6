"""Crops of a photo around an outlined thing, whose surroundings are replaced, dimmed or blurred."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from ...core.arrays import Float32, Mask, Pixels

Box = tuple[float, float, float, float]
Background = Literal["white", "dimmed", "blurred"]

WHITE = 255
# Margin of a masked crop on each side, as a fraction of its size. Margin and white background were chosen by
# measurement, see docs/design_notes/grounding.md.
_MARGIN = 0.2  # chosen on museum_room
_DIMMED = 0.33  # chosen on room_1, room_2, room_4, room_7
_BLUR = 0.05
"""Standard deviation of the blur of the surroundings, as a fraction of the side of the crop. Not fitted."""


@dataclass(frozen=True)
class Cut:
    """The part of a photo that lies in a square.

    Attributes
    ----------
    pixels : array of shape [h, w, 3], float32, 0 to 255
    left, top, side : float
        The square, in pixels of the photo. It may reach beyond the photo.
    x, y : int
        First column and row of `pixels` in the photo.
    """

    pixels: Float32
    left: float
    top: float
    side: float
    x: int
    y: int

    def squared(self) -> Pixels:
        """Return the square at the size of the photo, white beyond the photo, [n, n, 3]."""
        height, width = self.pixels.shape[:2]
        left, top = min(self.x, int(np.floor(self.left))), min(self.y, int(np.floor(self.top)))
        side = max(int(np.ceil(self.side)), self.x - left + width, self.y - top + height)
        square = np.full((side, side, 3), WHITE, np.uint8)
        shown = np.clip(np.rint(self.pixels), 0, WHITE)
        square[self.y - top : self.y - top + height, self.x - left : self.x - left + width] = shown
        return square


def cut_out(pixels: Pixels, box: Box, mask: Mask, background: Background) -> Cut:
    """Return the square around a box, with a margin around what a mask shows.

    Parameters
    ----------
    pixels : array of shape [H, W, 3], uint8, sRGB
    box : tuple of 4 float
        x0, y0, x1, y1 in pixels.
    mask : array of shape [H, W], bool
    background : str
        What becomes of the surroundings of the mask.
    """
    side = max(box[2] - box[0], box[3] - box[1], 1.0) * (1 + 2 * _MARGIN)
    left, top = (box[0] + box[2] - side) / 2, (box[1] + box[3] - side) / 2
    x0, y0 = max(0, int(np.floor(left))), max(0, int(np.floor(top)))
    x1, y1 = min(pixels.shape[1], int(np.ceil(left + side))), min(pixels.shape[0], int(np.ceil(top + side)))
    part = pixels[y0:y1, x0:x1].astype(np.float32)
    outside = ~mask[y0:y1, x0:x1]
    if background == "white":
        part[outside] = WHITE
    elif background == "dimmed":
        part[outside] = _DIMMED * part[outside]
    else:
        part[outside] = cv2.GaussianBlur(part, (0, 0), _BLUR * side)[outside]
    return Cut(part, left, top, side, x0, y0)
