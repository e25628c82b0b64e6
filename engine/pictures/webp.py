"""Lossless pictures of SOG files, by Pillow."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

_EFFORT = 50
"""Of 0 to 100: more takes longer and saves little."""
_METHOD = 4


def decode_picture(data: bytes) -> NDArray[np.uint8]:
    """Return the pixels [H, W, 4] of a WebP or PNG picture; raises `ValueError` when it is damaged."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(data), formats=("WEBP", "PNG")) as image:
            return np.array(image.convert("RGBA"))
    except (OSError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise ValueError(str(error)) from error


def encode_picture(pixels: NDArray[np.uint8]) -> bytes:
    """Return `pixels` [H, W, 4] as lossless WebP, which keeps also the colours of transparent pixels."""
    from PIL import Image

    stream = io.BytesIO()
    image = Image.fromarray(np.ascontiguousarray(pixels), "RGBA")
    image.save(stream, "WEBP", lossless=True, exact=True, quality=_EFFORT, method=_METHOD)
    return stream.getvalue()
