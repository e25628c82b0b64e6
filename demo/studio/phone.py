# SPDX-License-Identifier: GPL-3.0-or-later
"""The synthetic phone: lens, sensor and JPEG files.

Pixels are counted as in COLMAP, with the centre of the top left one at (0.5, 0.5), unless stated otherwise.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image


@dataclass(frozen=True)
class Phone:
    """A phone: COLMAP's SIMPLE_RADIAL lens with the principal point in the middle, and the format of its files.

    Attributes
    ----------
    width, height
        Size of the photos in pixels.
    equivalent_mm
        35 mm equivalent of the focal length, which compares diagonals, as in EXIF.
    k1
        Radial distortion.
    margin
        Pixels by which the ideal picture extends beyond the photo, whose corners barrel distortion moves inwards.
    quality, subsampling
        JPEG quality, and Pillow's number of the colour subsampling: 0 is 4:4:4, 2 is 4:2:0.
    """

    width: int = 800
    height: int = 600
    equivalent_mm: int = 26
    k1: float = -0.03
    margin: int = 16
    quality: int = 90
    subsampling: int = 0

    def scaled(self, factor: int) -> Phone:
        """Return the same phone with `factor` times as many pixels along each side."""
        return replace(self, width=factor * self.width, height=factor * self.height, margin=factor * self.margin)

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return self.equivalent_mm / float(np.hypot(36, 24)) * float(np.hypot(self.width, self.height))

    @property
    def centre(self) -> tuple[float, float]:
        """Principal point in pixels."""
        return self.width / 2, self.height / 2

    @property
    def ideal_size(self) -> tuple[int, int]:
        """Width and height of the undistorted render in pixels."""
        return self.width + 2 * self.margin, self.height + 2 * self.margin

    def ideal_positions(self) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y [h, w] in the undistorted render for each pixel of the photo.

        Inverts COLMAP's SIMPLE_RADIAL model, distorted = ideal * (1 + k1 * r_ideal**2), by fixed-point iteration.
        The positions are those of OpenCV, with pixel centres at integers.
        """
        u, v = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        cx, cy = self.centre
        x_photo, y_photo = (u - cx) / self.focal, (v - cy) / self.focal
        x, y = x_photo, y_photo
        for _ in range(20):
            scale = 1 + self.k1 * (x * x + y * y)
            x, y = x_photo / scale, y_photo / scale
        wide, tall = self.ideal_size
        columns = x * self.focal + wide / 2 - 0.5
        rows = y * self.focal + tall / 2 - 0.5
        return columns.astype(np.float32), rows.astype(np.float32)

    def expose(self, linear: np.ndarray, stops: float, rng: np.random.Generator) -> np.ndarray:
        """Return the photo's 8-bit sRGB pixels of an undistorted linear render."""
        # Clipped, because cubic resampling causes ringing around overexposed highlights.
        seen = cv2.remap(np.clip(linear * 2.0**stops, 0, 1.5), *self.ideal_positions(), cv2.INTER_CUBIC)
        seen = np.clip(seen, 0, 1)
        seen = np.clip(seen + rng.normal(0, 1, seen.shape) * np.sqrt(1e-6 + 6e-5 * seen), 0, 1)
        return srgb_pixels(seen)

    def remap_ids(self, ids: np.ndarray) -> np.ndarray:
        """Return an id picture with the distortion of the lens, without interpolation."""
        return cv2.remap(ids, *self.ideal_positions(), cv2.INTER_NEAREST)

    def save_photo(self, pixels: np.ndarray, path: Path, description: str) -> None:
        """Write a JPEG with the phone's EXIF tags atomically."""
        picture = Image.fromarray(pixels)
        exif = Image.Exif()
        exif[0x010E] = description  # ImageDescription
        exif[0x010F] = "Gaussian Heritage"  # Make
        exif[0x0110] = "Synthetic phone"  # Model
        details = exif.get_ifd(0x8769)
        details[0xA405] = self.equivalent_mm  # FocalLengthIn35mmFilm
        unfinished = path.with_suffix(".part")
        picture.save(unfinished, "JPEG", quality=self.quality, subsampling=self.subsampling, exif=exif)
        os.replace(unfinished, path)


def srgb_pixels(linear: np.ndarray) -> np.ndarray:
    """Return 8-bit sRGB pixels of linear values from 0 to 1."""
    srgb = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (srgb * 255 + 0.5).astype(np.uint8)


def save_ids(ids: np.ndarray, path: Path) -> None:
    """Write an 8-bit PNG of instance ids atomically."""
    unfinished = path.with_suffix(".part")
    Image.fromarray(ids).save(unfinished, "PNG", optimize=True)
    os.replace(unfinished, path)
