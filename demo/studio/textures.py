# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural textures and noise for all scenes. Textures are uint8 sRGB arrays of shape (h, w, 3)."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw


def noise(height: int, width: int, cells: int, octaves: int, seed: int, tile: bool = False) -> np.ndarray:
    """Return fractal noise in 0..1; with `tile` it repeats seamlessly in x."""
    rng = np.random.default_rng(seed)
    total = np.zeros((height, width), np.float32)
    for octave in range(octaves):
        n = cells * 2**octave
        grid = rng.random((max(2, n * height // width), n), dtype=np.float32)
        if tile:
            grid = np.concatenate([grid, grid, grid], axis=1)
            wide = Image.fromarray(grid).resize((3 * width, height), Image.BICUBIC)
            layer = np.asarray(wide)[:, width : 2 * width]
        else:
            layer = np.asarray(Image.fromarray(grid).resize((width, height), Image.BICUBIC))
        total += (layer - 0.5) / 2**octave
    return np.clip(total * 0.9 + 0.5, 0, 1)


def shade(picture: Image.Image, cells: int, strength: float, seed: int) -> np.ndarray:
    """Return a picture darkened and lightened by fractal noise."""
    factor = 1 + strength * (noise(picture.height, picture.width, cells, 6, seed, tile=True) - 0.5)
    return np.clip(np.asarray(picture) * factor[..., None], 0, 255).astype(np.uint8)


def label(seed: int) -> np.ndarray:
    """Paint a museum label: a heading and lines of grey text too small to read."""
    rng = np.random.default_rng(seed)
    picture = Image.new("RGB", (320, 200), "#efe9da")
    draw = ImageDraw.Draw(picture)
    draw.rectangle([6, 6, 314, 194], outline="#8a7a55", width=4)
    for row in range(7):
        x, y, tall = 24, 24 + row * 23 + (8 if row else 0), 18 if row == 0 else 10
        while x < 270:
            long = int(rng.integers(10, 46))
            draw.rectangle([x, y, min(x + long, 296), y + tall], fill="#2a2622" if row == 0 else "#5a544c")
            x += long + 8
            if row == 0 and x > 190:
                break
    return np.asarray(picture)
