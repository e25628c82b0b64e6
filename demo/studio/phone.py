# SPDX-License-Identifier: GPL-3.0-or-later
"""The synthetic phone: lens, sensor and JPEG files.

Pixels are counted as in COLMAP, with the centre of the top left one at (0.5, 0.5), unless stated otherwise.
"""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

WIDTH, HEIGHT = 800, 600
EQUIVALENT_MM = 26
# In pixels; the 35 mm equivalent of EXIF compares diagonals.
FOCAL = EQUIVALENT_MM / float(np.hypot(36, 24)) * float(np.hypot(WIDTH, HEIGHT))
CX, CY, K1 = WIDTH / 2, HEIGHT / 2, -0.03
# Pixels. The ideal picture must extend beyond the photo, whose corners barrel distortion moves inwards.
MARGIN = 16
IDEAL_WIDTH, IDEAL_HEIGHT = WIDTH + 2 * MARGIN, HEIGHT + 2 * MARGIN


def ideal_positions() -> tuple[np.ndarray, np.ndarray]:
    """Return x and y [h, w] in the undistorted render for each pixel of the photo.

    Inverts COLMAP's SIMPLE_RADIAL model, distorted = ideal * (1 + k1 * r_ideal**2), by fixed-point iteration.
    The positions are those of OpenCV, with pixel centres at integers.
    """
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    x_photo, y_photo = (u - CX) / FOCAL, (v - CY) / FOCAL
    x, y = x_photo, y_photo
    for _ in range(20):
        scale = 1 + K1 * (x * x + y * y)
        x, y = x_photo / scale, y_photo / scale
    columns = x * FOCAL + IDEAL_WIDTH / 2 - 0.5
    rows = y * FOCAL + IDEAL_HEIGHT / 2 - 0.5
    return columns.astype(np.float32), rows.astype(np.float32)


def expose(linear: np.ndarray, stops: float, rng: np.random.Generator) -> np.ndarray:
    """Return the photo's 8-bit sRGB pixels of an undistorted linear render."""
    # Clipped, because cubic resampling causes ringing around overexposed highlights.
    seen = cv2.remap(np.clip(linear * 2.0**stops, 0, 1.5), *ideal_positions(), cv2.INTER_CUBIC)
    seen = np.clip(seen, 0, 1)
    seen = np.clip(seen + rng.normal(0, 1, seen.shape) * np.sqrt(1e-6 + 6e-5 * seen), 0, 1)
    srgb = np.where(seen <= 0.0031308, seen * 12.92, 1.055 * seen ** (1 / 2.4) - 0.055)
    return (srgb * 255 + 0.5).astype(np.uint8)


def remap_ids(ids: np.ndarray) -> np.ndarray:
    """Return an id picture with the distortion of the lens, without interpolation."""
    return cv2.remap(ids, *ideal_positions(), cv2.INTER_NEAREST)


def save_photo(pixels: np.ndarray, path: Path, description: str) -> None:
    """Write a JPEG with the phone's EXIF tags atomically."""
    picture = Image.fromarray(pixels)
    exif = Image.Exif()
    exif[0x010E] = description  # ImageDescription
    exif[0x010F] = "Gaussian Heritage"  # Make
    exif[0x0110] = "Synthetic phone"  # Model
    details = exif.get_ifd(0x8769)
    details[0xA405] = EQUIVALENT_MM  # FocalLengthIn35mmFilm
    unfinished = path.with_suffix(".part")
    picture.save(unfinished, "JPEG", quality=90, subsampling=0, exif=exif)
    os.replace(unfinished, path)


def save_ids(ids: np.ndarray, path: Path) -> None:
    """Write an 8-bit PNG of instance ids atomically."""
    unfinished = path.with_suffix(".part")
    Image.fromarray(ids).save(unfinished, "PNG", optimize=True)
    os.replace(unfinished, path)
