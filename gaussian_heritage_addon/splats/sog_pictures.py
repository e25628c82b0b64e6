"""Lossless WebP pictures of SOG files, decoded and encoded by Blender itself."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

_NAME = "Gaussian Heritage SOG"


def decode_picture(data: bytes) -> NDArray[np.uint8]:
    """Return the pixels [H, W, 4] of a WebP or PNG picture; raises `ValueError` when it is damaged."""
    suffix = ".png" if data.startswith(b"\x89PNG") else ".webp"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"picture{suffix}"
        file.write_bytes(data)
        try:
            image = bpy.data.images.load(str(file), check_existing=False)
        except RuntimeError as error:
            raise ValueError("Blender cannot read it") from error
        try:
            # Numbers, not colours: no conversion, and no product with the opacity.
            image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
            width, height = image.size
            if not width or not height or image.is_float:
                raise ValueError("Blender cannot read it")
            values = np.empty(width * height * image.channels, np.float32)
            image.pixels.foreach_get(values)
            pixels = np.full((height, width, 4), 255, np.uint8)
            # Blender begins with the lowest row.
            pixels[..., : image.channels] = np.round(values.reshape(height, width, -1)[::-1] * 255)
            return pixels
        finally:
            bpy.data.images.remove(image)


def encode_picture(pixels: NDArray[np.uint8]) -> bytes:
    """Return `pixels` [H, W, 4] as lossless WebP; the colours of pixels with an alpha of 0 are lost."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new(_NAME, width, height, alpha=True)
    try:
        image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
        image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1], np.float32).ravel() / np.float32(255))
        image.file_format = "WEBP"
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "picture.webp"
            image.filepath_raw = str(file)
            # Blender packs without loss at the highest quality.
            image.save(quality=100)
            return file.read_bytes()
    finally:
        bpy.data.images.remove(image)
