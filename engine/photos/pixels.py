"""Load the pixels of a photo as all packages use them: upright, 8 bits, three channels, sRGB."""

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
from .exif import UPRIGHT_TRANSPOSES, focal_in_pixels, orientation_of, without_exif_warnings

__all__ = ["can_read_heic", "load_pixels", "open_photo", "upright_pixels", "upright_with_alpha"]

_LOG = logging.getLogger(__name__)

# Protects against decompression bombs. The largest camera backs used in museums have fewer pixels.
_MAX_PIXELS = 400_000_000
# Pillow's own limit warns at 89 million pixels, which reproduction cameras exceed; `_MAX_PIXELS` replaces it.
Image.MAX_IMAGE_PIXELS = None

_SRGB = ImageCms.createProfile("sRGB")
_heic_ready = False


def can_read_heic() -> bool:
    """Return whether the optional package ``pillow-heif`` is installed, and register it with Pillow."""
    global _heic_ready
    if not _heic_ready and importlib.util.find_spec("pillow_heif") is not None:
        importlib.import_module("pillow_heif").register_heif_opener()
        _heic_ready = True
    return _heic_ready


def load_pixels(path: Path, *, max_side: int | None = None) -> NDArray[np.uint8]:
    """Return the pixels of a photo with EXIF rotation applied.

    Parameters
    ----------
    path : Path
        JPEG, PNG, TIFF or WebP; HEIC if pillow-heif is installed.
    max_side : int, optional
        The picture is reduced so that its longest side is at most this many pixels; it is never enlarged. By default
        the full size.

    Returns
    -------
    array of shape [H, W, 3], uint8, sRGB
        16 bits are rounded to 8, gray is repeated in three channels, transparent pixels are composited over white, and
        CMYK and wide-gamut colours are converted with the profile in the file (CMYK without a profile with Pillow's
        default formula).

    Raises
    ------
    PhotoError
        When the file is missing, empty, damaged, truncated, too large, or contains 32-bit floats.
    """
    image, _ = open_photo(path, max_side=max_side)
    return upright_pixels(image, max_side=max_side)


def open_photo(path: Path, *, max_side: int | None = None) -> tuple[Image.Image, float | None]:
    """Return the decoded picture before rotation, and its EXIF focal length in full-size pixels (None if unknown).

    Parameters
    ----------
    path : Path
        The photo.
    max_side : int, optional
        A JPEG may be decoded at a half, a quarter or an eighth of its size, never smaller than `max_side`. Its full
        size is then stored in ``image.info["full_size"]``.

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
                    "Reduce its size."
                )
            full_size = image.size
            if max_side is not None:
                image.draft(None, _size_within(full_size, max_side))
            image.load()
    except Image.UnidentifiedImageError as error:
        raise PhotoError(f"{path.name} is not a picture that can be read. Save it as JPEG, PNG or TIFF.") from error
    except FileNotFoundError as error:
        raise PhotoError(f"{path} is missing. Restore the photo and run again.") from error
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, TypeError, KeyError, ArithmeticError) as error:
        # Pillow's decoders raise any of these exceptions on damaged data.
        _LOG.info("%s: %s", path, error)
        raise PhotoError(
            f"{path.name} is damaged or cut short and cannot be read. Copy it again from the camera."
        ) from error
    # Pillow rotates a TIFF on loading, which may swap its width and height but never changes the scale.
    drafted = image.format in ("JPEG", "MPO") and image.size != full_size
    image.info["full_size"] = full_size if drafted else image.size
    focal = focal_in_pixels(image)
    if focal is not None and drafted:
        focal *= max(full_size) / max(image.size)
    return image, focal


def _size_within(size: tuple[int, int], max_side: int) -> tuple[int, int]:
    """Return `size` reduced so that the longest side is at most `max_side`, and each side at least 1."""
    longest = max(size)
    if longest <= max_side:
        return size
    return max(1, round(size[0] * max_side / longest)), max(1, round(size[1] * max_side / longest))


def upright_pixels(image: Image.Image, *, max_side: int | None = None) -> NDArray[np.uint8]:
    """Return the uint8 sRGB pixels [H, W, 3] of a picture from `open_photo`; see `load_pixels`.

    Raises
    ------
    PhotoError
        For pictures with 32-bit floats, whose range is unknown.
    """
    return upright_with_alpha(image, max_side=max_side)[0]


def upright_with_alpha(
    image: Image.Image, *, max_side: int | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return the pixels as from `upright_pixels` and their alpha [H, W], 0 to 255, or None if the file has no alpha."""
    transpose = UPRIGHT_TRANSPOSES.get(orientation_of(image))
    full_size = image.info.get("full_size", image.size)
    profile = image.info.get("icc_profile")
    picture = _eight_bits(image)
    size = full_size if max_side is None else _size_within(full_size, max_side)
    if picture.size != size:
        # A JPEG with an odd side, decoded at a reduced size, covers slightly more than the photo. The box excludes this
        # fraction of a pixel, so that positions stay exact.
        reduction = 2 ** round(np.log2(full_size[0] / picture.width)) if picture.size != full_size else 1
        box = (0.0, 0.0, min(picture.width, full_size[0] / reduction), min(picture.height, full_size[1] / reduction))
        if picture.mode == "RGBA":
            picture = picture.convert("RGBa")
        picture = picture.resize(size, Image.Resampling.HAMMING, box=box)
        if picture.mode == "RGBa":
            picture = picture.convert("RGBA")
    alpha = picture.getchannel("A") if picture.mode == "RGBA" else None
    picture = _to_srgb(picture, profile)
    return _transposed(picture, transpose), None if alpha is None else _transposed(alpha, transpose)


def _transposed(picture: Image.Image, transpose: Image.Transpose | None) -> NDArray[np.uint8]:
    upright = picture if transpose is None else picture.transpose(transpose)
    return np.ascontiguousarray(np.asarray(upright, dtype=np.uint8))


def _eight_bits(image: Image.Image) -> Image.Image:
    """Return `image` converted to mode L, RGB, RGBA, CMYK or LAB."""
    if image.mode.startswith("I"):
        values = np.asarray(image).astype(np.float64)
        # Mode I contains the 16 bits of a gray file; 65535 / 257 = 255 exactly.
        return Image.fromarray(np.clip(np.rint(values / 257.0), 0, 255).astype(np.uint8))
    if image.mode == "F":
        raise PhotoError("The picture contains 32-bit floats, whose range is unknown. Save it with 8 or 16 bits.")
    if image.mode in ("L", "RGB", "RGBA", "CMYK", "LAB"):
        # A file can also declare one of its colours as transparent.
        return image.convert("RGBA") if "transparency" in image.info and image.mode in ("L", "RGB") else image
    has_alpha = image.mode in ("LA", "La", "PA", "RGBa") or "transparency" in image.info
    return image.convert("RGBA" if has_alpha else "RGB")


def _to_srgb(picture: Image.Image, profile: bytes | None) -> Image.Image:
    """Return `picture` as RGB in sRGB, composited over white where it has alpha."""
    alpha = None
    if picture.mode == "RGBA":
        alpha = picture.getchannel("A")
        picture = picture.convert("RGB")
    if profile:
        picture = _apply_profile(picture, profile)
    picture = picture.convert("RGB")
    if alpha is not None:
        picture = Image.composite(picture, Image.new("RGB", picture.size, (255, 255, 255)), alpha)
    return picture


def _apply_profile(picture: Image.Image, profile: bytes) -> Image.Image:
    """Return `picture` converted to sRGB with its ICC profile; unchanged if the profile is sRGB or does not fit it."""
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        if "srgb" in ImageCms.getProfileDescription(source).lower():
            return picture
        converted = ImageCms.profileToProfile(picture, source, _SRGB, outputMode="RGB")
    except (ImageCms.PyCMSError, OSError, ValueError) as error:
        _LOG.warning("A colour profile that does not fit its picture is ignored: %s", error)
        return picture
    if converted is None:
        raise AssertionError("profileToProfile returns None only with inPlace")
    return converted
