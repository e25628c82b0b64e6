"""Pixels of a photo as every room sees them: upright, 8 bits, three channels, sRGB."""

from __future__ import annotations

import importlib
import importlib.util
import io
import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms

from ..errors import PhotoError
from .exif import TURNS, focal_in_pixels, orientation_of, without_exif_warnings

__all__ = ["can_read_heic", "load_pixels", "open_photo", "upright_pixels", "upright_with_alpha"]

_LOG = logging.getLogger(__name__)

# A decompression bomb would take the machine's memory; the largest museum backs stay below this.
_MAX_PIXELS = 400_000_000
# Pillow's own guard warns at 89 million pixels, which real repro cameras exceed; ours replaces it.
Image.MAX_IMAGE_PIXELS = None

_SRGB = ImageCms.createProfile("sRGB")
_heic_ready = False


def can_read_heic() -> bool:
    """Return whether the optional package ``pillow-heif`` is there, and make Pillow use it."""
    global _heic_ready
    if not _heic_ready and importlib.util.find_spec("pillow_heif") is not None:
        importlib.import_module("pillow_heif").register_heif_opener()
        _heic_ready = True
    return _heic_ready


def load_pixels(path: Path, *, max_side: int | None = None) -> NDArray[np.uint8]:
    """Return the pixels of a photo, EXIF rotation applied.

    Parameters
    ----------
    path : Path
        JPEG, PNG, TIFF, WebP, and HEIC where pillow-heif is installed.
    max_side : int, optional
        The picture is made smaller so that its longest side is at most this many pixels; it is never enlarged.
        By default all pixels.

    Returns
    -------
    array of shape [H, W, 3], uint8, sRGB
        16 bits are rounded to 8; gray is repeated; transparent pixels lie over white; CMYK and wide-gamut colours
        are converted through the profile in the file (CMYK without one by Pillow's plain rule).

    Raises
    ------
    PhotoError
        When the file is missing, empty, damaged, cut short, too large, or holds 32-bit floats.
    """
    image, _ = open_photo(path, max_side=max_side)
    return upright_pixels(image, max_side=max_side)


def open_photo(path: Path, *, max_side: int | None = None) -> tuple[Image.Image, float | None]:
    """Return the decoded picture before rotation and its EXIF focal length in full-size pixels (None when unknown).

    Parameters
    ----------
    path : Path
        The photo.
    max_side : int, optional
        A JPEG may be decoded at a half, quarter or eighth of its size when that still covers `max_side`; its true
        size then stands in ``image.info["full_size"]``.

    Raises
    ------
    PhotoError
        See `load_pixels`.
    """
    can_read_heic()
    try:
        if path.stat().st_size == 0:
            raise PhotoError(f"{path.name} is empty. Copy it again from the camera.")
        with path.open("rb") as stream:
            with without_exif_warnings():
                image = Image.open(stream)
            if image.width * image.height > _MAX_PIXELS:
                raise PhotoError(
                    f"{path.name} has {image.width} x {image.height} pixels, more than can be read safely. "
                    "Make it smaller."
                )
            full_size = image.size
            if max_side is not None:
                image.draft(None, _fit(full_size, max_side))
            image.load()
    except Image.UnidentifiedImageError as error:
        raise PhotoError(f"{path.name} is not a picture that can be read. Save it as JPEG, PNG or TIFF.") from error
    except FileNotFoundError as error:
        raise PhotoError(f"{path} is gone. Put the photo back and run again.") from error
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, TypeError, KeyError, ArithmeticError) as error:
        # Pillow's decoders raise any of these on damaged bytes.
        _LOG.info("%s: %s", path, error)
        raise PhotoError(
            f"{path.name} is damaged or cut short and cannot be read. Copy it again from the camera."
        ) from error
    # TIFF is turned on loading, so the size before and after may differ by a swap, never by scale.
    drafted = image.format in ("JPEG", "MPO") and image.size != full_size
    image.info["full_size"] = full_size if drafted else image.size
    focal = focal_in_pixels(image)
    if focal is not None and drafted:
        focal *= max(full_size) / max(image.size)
    return image, focal


def _fit(size: tuple[int, int], max_side: int) -> tuple[int, int]:
    """Return `size` made smaller so that its longest side is at most `max_side`, each side at least 1."""
    longest = max(size)
    if longest <= max_side:
        return size
    return max(1, round(size[0] * max_side / longest)), max(1, round(size[1] * max_side / longest))


def upright_pixels(image: Image.Image, *, max_side: int | None = None) -> NDArray[np.uint8]:
    """Return the uint8 sRGB pixels [H, W, 3] of a picture from `open_photo`, see `load_pixels`.

    Raises
    ------
    PhotoError
        For 32-bit float pictures, whose range is unknown.
    """
    return upright_with_alpha(image, max_side=max_side)[0]


def upright_with_alpha(
    image: Image.Image, *, max_side: int | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return the pixels as of `upright_pixels`, and their alpha [H, W], 0 to 255, None where the file has none."""
    turn = TURNS.get(orientation_of(image))
    full_size = image.info.get("full_size", image.size)
    profile = image.info.get("icc_profile")
    picture = _eight_bits(image)
    size = full_size if max_side is None else _fit(full_size, max_side)
    if picture.size != size:
        # A decoded half of an odd size stands for a little more than the photo: leave that part of a pixel out,
        # so that positions stay exact.
        half = 2 ** round(np.log2(full_size[0] / picture.width)) if picture.size != full_size else 1
        box = (0.0, 0.0, min(picture.width, full_size[0] / half), min(picture.height, full_size[1] / half))
        if picture.mode == "RGBA":
            picture = picture.convert("RGBa")
        picture = picture.resize(size, Image.Resampling.HAMMING, box=box)
        if picture.mode == "RGBa":
            picture = picture.convert("RGBA")
    alpha = picture.getchannel("A") if picture.mode == "RGBA" else None
    picture = _to_srgb(picture, profile)
    return _turned(picture, turn), None if alpha is None else _turned(alpha, turn)


def _turned(picture: Image.Image, turn: Image.Transpose | None) -> NDArray[np.uint8]:
    return np.ascontiguousarray(np.asarray(picture if turn is None else picture.transpose(turn), dtype=np.uint8))


def _eight_bits(image: Image.Image) -> Image.Image:
    """Return `image` with mode L, RGB, RGBA, CMYK or LAB."""
    if image.mode.startswith("I"):
        values = np.asarray(image).astype(np.float64)
        # Mode I holds the 16 bits of a gray file; 65535/257 = 255 exactly.
        return Image.fromarray(np.clip(np.rint(values / 257.0), 0, 255).astype(np.uint8))
    if image.mode == "F":
        raise PhotoError("The picture holds 32-bit floats, whose range is unknown. Save it with 8 or 16 bits.")
    if image.mode in ("L", "RGB", "RGBA", "CMYK", "LAB"):
        # Transparency may also be one named colour.
        return image.convert("RGBA") if "transparency" in image.info and image.mode in ("L", "RGB") else image
    has_alpha = image.mode in ("LA", "La", "PA", "RGBa") or "transparency" in image.info
    return image.convert("RGBA" if has_alpha else "RGB")


def _to_srgb(picture: Image.Image, profile: bytes | None) -> Image.Image:
    """Return `picture` as RGB in sRGB, alpha laid over white."""
    alpha = None
    if picture.mode == "RGBA":
        alpha = picture.getchannel("A")
        picture = picture.convert("RGB")
    if profile:
        picture = _through_profile(picture, profile)
    picture = picture.convert("RGB")
    if alpha is not None:
        picture = Image.composite(picture, Image.new("RGB", picture.size, (255, 255, 255)), alpha)
    return picture


def _through_profile(picture: Image.Image, profile: bytes) -> Image.Image:
    """Return `picture` converted to sRGB by its ICC profile; as it is when the profile says sRGB or does not fit it."""
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        if "srgb" in ImageCms.getProfileDescription(source).lower():
            return picture
        converted = ImageCms.profileToProfile(picture, source, _SRGB, outputMode="RGB")
    except (ImageCms.PyCMSError, OSError, ValueError) as error:
        _LOG.warning("a colour profile that does not fit its picture is ignored: %s", error)
        return picture
    if converted is None:
        raise AssertionError("profileToProfile returns None only with inPlace")
    return converted
