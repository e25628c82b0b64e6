"""HEIC photos: the decoder, and colours that the file states by numbers instead of a colour profile."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ..core.errors import PhotoError
from ..core.visible_text import visible

_NUMBERS = "nclx_profile"
"""The name in pillow-heif for colours that are stated by numbers of ITU-T H.273."""

_SRGB_PRIMARIES = frozenset({1, 2, 5, 6, 7})
"""BT.709, unspecified, and standard television, which are shown as sRGB everywhere."""
_WIDE_PRIMARIES = frozenset({9, 12})
"""BT.2020 and Display P3; their white is that of sRGB."""
_USUAL_CURVES = frozenset({1, 2, 4, 5, 6, 7, 11, 13, 14, 15})
_HDR_CURVES = {16: "PQ", 18: "HLG"}
_SRGB_CORNERS = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290))
"""Chromaticities of red, green, blue and white."""
_LEVELS = 4096
"""Steps of the table from light to sRGB: below half a level of 8 bits everywhere but in the darkest two."""

_is_registered = False


def can_read_heic() -> bool:
    """Return whether the package ``pillow-heif`` is installed, and register it with Pillow."""
    global _is_registered
    if not _is_registered:
        try:
            import pillow_heif
        # Missing in an environment that was set up before its list of packages changed, or damaged.
        except ImportError:
            return False
        # A thumbnail must not stand for the photo. Threads of its own would take memory that is not reserved; photos
        # are decoded on all cores already.
        pillow_heif.register_heif_opener(thumbnails=False, depth_images=False, aux_images=False, decode_threads=1)
        _is_registered = True
    return _is_registered


def require_heic_reader(path: Path) -> None:
    """Raise `PhotoError` when the HEIC file at `path` cannot be read in this environment."""
    if not can_read_heic():
        raise PhotoError(
            f"{visible(path.name)} is a HEIC file, and the package pillow-heif, which reads them, is not installed. "
            "Set up the engine again, or save the photo as JPEG."
        )


def require_ordinary_colours(image: Image.Image, path: Path) -> None:
    """Raise `PhotoError` when the colours of a HEIC file have no certain place in sRGB."""
    numbers = image.info.get(_NUMBERS)
    if numbers is None:
        return
    curve, primaries = numbers["transfer_characteristics"], numbers["color_primaries"]
    if curve not in _USUAL_CURVES:
        kind = _HDR_CURVES.get(curve, f"number {curve}")
        raise PhotoError(
            f"{visible(path.name)} stores brightness for HDR screens ({kind}), which has no certain place in 8 bits. "
            "Switch HDR off in the camera, or save the photo as JPEG."
        )
    if primaries not in _SRGB_PRIMARIES | _WIDE_PRIMARIES:
        raise PhotoError(
            f"{visible(path.name)} stores colours in a form that is not read (primaries {primaries}). Save it as JPEG."
        )


def conversion_of_numbers(info: dict[str, Any]) -> Callable[[Image.Image], Image.Image] | None:
    """Return a function that converts RGB pictures of wide colours to sRGB; None where the file states none.

    Parameters
    ----------
    info : dict
        Of the picture, as Pillow gives it.
    """
    numbers = info.get(_NUMBERS)
    if numbers is None or numbers["color_primaries"] not in _WIDE_PRIMARIES:
        return None
    corners = tuple(
        (numbers[f"color_primary_{name}_x"], numbers[f"color_primary_{name}_y"])
        for name in ("red", "green", "blue", "white")
    )
    matrix = (np.linalg.inv(_to_xyz(_SRGB_CORNERS)) @ _to_xyz(corners)).astype(np.float32)
    levels = np.arange(256) / 255.0
    to_light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4).astype(np.float32)
    light = np.arange(_LEVELS) / (_LEVELS - 1)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    to_levels = np.rint(255.0 * curve).astype(np.uint8)

    def convert(picture: Image.Image) -> Image.Image:
        mixed = to_light[np.asarray(picture.convert("RGB"))] @ matrix.T
        np.clip(mixed, 0.0, 1.0, out=mixed)
        return Image.fromarray(to_levels[np.rint(mixed * (_LEVELS - 1)).astype(np.int32)])

    return convert


def _to_xyz(corners: tuple[tuple[float, float], ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the matrix from light in the colours with these chromaticities to XYZ."""
    columns = np.array([(x / y, 1.0, (1.0 - x - y) / y) for x, y in corners]).T
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])
