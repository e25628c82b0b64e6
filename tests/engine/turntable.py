"""Photos of a textured thing that turns before a textured background that stands still."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

CENTRE, RADIUS = (160, 120), 55
_SIZE = (320, 240)


def write_turntable(folder: Path, count: int) -> NDArray[np.bool_]:
    """Write `count` photos to `folder` and return where the thing is, [240, 320]; it is round and turns by 25°."""
    rng = np.random.default_rng(5)
    folder.mkdir(parents=True)
    wall, thing = (
        cv2.GaussianBlur(rng.uniform(0, 255, (_SIZE[1], _SIZE[0], 3)).astype(np.float32), (0, 0), 2.0) for _ in range(2)
    )
    wall, thing = 90 + 1.5 * (wall - 128), np.array([150.0, 90.0, 60.0]) + 2.5 * (thing - 128)
    rows, columns = np.mgrid[0 : _SIZE[1], 0 : _SIZE[0]]
    inside = np.hypot(columns - CENTRE[0], rows - CENTRE[1]) < RADIUS
    for number in range(count):
        turn = cv2.getRotationMatrix2D(CENTRE, 25.0 * number, 1.0)
        turned = cv2.warpAffine(thing, turn, _SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        pixels = np.where(inside[..., None], turned, wall) + rng.normal(0.0, 1.0, wall.shape)
        Image.fromarray(pixels.clip(0, 255).astype(np.uint8)).save(folder / f"turn_{number:02d}.jpg", quality=93)
    return inside
