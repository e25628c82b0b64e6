"""Decode the pixels of a photo as all packages use them: upright, 8 bits, three channels, sRGB.

These functions decode in this process, whatever the size. `bounded` calls them within bounds of memory and time.
"""

from __future__ import annotations

import contextlib
import io
import logging
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms, TiffImagePlugin

from ..core.errors import FormatError, HeritageError, PhotoError, is_out_of_memory
from ..core.files import opened
from ..core.visible_text import visible
from .exif import UPRIGHT_TRANSPOSES, focal_in_pixels, orientation_of, without_pillow_warnings
from .heic import conversion_of_numbers, require_heic_reader, require_ordinary_colours
from .heic_tiles import load_heic
from .kinds import HEIC, PICTURES, kind_of_stream, refusal_of
from .structure import require_usual_structure

_LOG = logging.getLogger(__name__)

_FORMATS = {"JPEG": "JPEG", "PNG": "PNG", "TIFF": "TIFF", "WebP": "WEBP", HEIC: "HEIF"}
"""Pillow's names of the formats that are read. Pillow's other plug-ins are not tried: one of them starts another
program."""
# Protects against decompression bombs. The largest camera backs used in museums have fewer pixels.
MAX_PIXELS = 400_000_000
_MAX_PIXELS_OF_FORMAT = {"WEBP": 30_000_000}
"""Formats whose decoder takes so much memory per pixel that fewer can be read safely."""
# Pillow's own limit warns at 89 million pixels, which reproduction cameras exceed; `MAX_PIXELS` replaces it.
Image.MAX_IMAGE_PIXELS = None
# Pillow's own decoder of uncompressed TIFF takes separate planes of 16 bits for 8; libtiff decodes all of them.
TiffImagePlugin.READ_LIBTIFF = True

_BYTES_OF_MODE = {"1": 1, "L": 1, "P": 1, "I;16": 2, "I;16B": 2, "I;16L": 2, "I;16N": 2}
"""Bytes per pixel of a decoded picture by Pillow's mode; 4 for all others."""
_NATIVE_MODES = ("L", "RGB", "RGBX", "RGBA", "CMYK", "LAB")
"""Modes that need no conversion before the picture is reduced."""
_RESULT_BYTES = 4
"""Bytes per pixel of the result: three colours and alpha, or the reduced picture."""
_SCRATCH_BYTES = {"JPEG": 0, "MPO": 0, "PNG": 0, "TIFF": 8}
"""Bytes per pixel that the decoder of a format takes in addition."""
_SCRATCH_BYTES_OF_WHOLE_FILES = 12
"""The same for WebP and HEIC."""
_COEFFICIENT_BYTES = 2
"""Bytes per pixel and channel that the decoder takes for a progressive JPEG."""
_STRIP_PIXELS = 1 << 20
"""Number of pixels that are converted at once."""
_STRIP_BYTES = 48 << 20
"""Memory that is taken while a strip is converted."""

_SRGB = ImageCms.createProfile("sRGB")


@dataclass(frozen=True)
class PhotoHeader:
    """The header of a photo.

    Attributes
    ----------
    width, height : int
        Size in pixels before rotation.
    n_bytes : int
        Memory that decoding takes at most.
    """

    width: int
    height: int
    n_bytes: int


def read_header(path: Path, *, max_side: int | None = None) -> PhotoHeader:
    """Return the size of a photo and what decoding it takes, without decoding it; see `open_photo`."""
    with photo_errors(path), opened_picture(path, max_side) as (image, full_size):
        scratch = _SCRATCH_BYTES.get(str(image.format), _SCRATCH_BYTES_OF_WHOLE_FILES)
        if image.info.get("progressive"):
            scratch += _COEFFICIENT_BYTES * len(image.getbands())
        is_native = image.mode in _NATIVE_MODES and "transparency" not in image.info
        per_pixel = _BYTES_OF_MODE.get(image.mode, 4) + (0 if is_native else 4) + _RESULT_BYTES
        n_bytes = per_pixel * image.width * image.height + scratch * full_size[0] * full_size[1] + _STRIP_BYTES
        return PhotoHeader(*full_size, n_bytes)


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
        When the file is missing, not a file, empty, no picture, damaged or truncated, or has more than 400 million
        pixels.
    """
    with photo_errors(path), opened_picture(path, max_side) as (image, full_size):
        if image.format == _FORMATS[HEIC]:
            image = load_heic(image)
        else:
            image.load()
        # Pillow rotates a TIFF on loading, which may swap its width and height but never changes the scale.
        drafted = image.format in ("JPEG", "MPO") and image.size != full_size
        image.info["full_size"] = full_size if drafted else image.size
        focal = focal_in_pixels(image)
        if focal is not None and drafted:
            focal *= max(full_size) / max(image.size)
        return image, focal


@contextlib.contextmanager
def photo_errors(path: Path) -> Iterator[None]:
    """Turn every exception of reading the photo `path` into a `PhotoError`: a photo can only reject itself."""
    name = visible(path.name)
    try:
        yield
    except FormatError as error:
        raise PhotoError(visible(str(error))) from error
    except HeritageError:
        raise
    # Pillow's decoders raise exceptions of many types on damaged data.
    except Exception as error:
        if is_out_of_memory(error):
            raise PhotoError(
                f"{name} takes more memory than its size should, or than is free. Reduce its size, or close programs."
            ) from error
        _LOG.info("%s: %r", name, error)
        raise PhotoError(
            f"{name} is damaged or cut short and cannot be read. Copy it again from the camera."
        ) from error


@contextlib.contextmanager
def opened_picture(path: Path, max_side: int | None) -> Iterator[tuple[Image.Image, tuple[int, int]]]:
    """Yield the picture, whose pixels are not decoded yet, and its full size.

    Parameters
    ----------
    max_side : int or None
        Longest side in pixels that is needed: JPEG is decoded at the nearest size above it. None: the full size.

    Raises
    ------
    PhotoError
        When the file is no picture that can be read safely; the message says what to do.
    """
    _require_file(path)
    # Pillow's OSError about a damaged picture must not count as one of the file system.
    with opened(path, advice="Check its permissions.") as stream, photo_errors(path), without_pillow_warnings():
        kind = kind_of_stream(stream)
        refusal = refusal_of(kind, path.suffix)
        if kind not in PICTURES:
            name = visible(path.name)
            raise PhotoError(f"{name} is not a picture that can be read. {refusal or 'Save it as JPEG, PNG or TIFF.'}")
        require_usual_structure(stream, path)
        if kind == HEIC:
            require_heic_reader(path)
        image = _identified(stream, path, kind)
        require_ordinary_colours(image, path)
        most = _MAX_PIXELS_OF_FORMAT.get(image.format or "", MAX_PIXELS)
        if image.width * image.height > most:
            advice = "Reduce its size." if most == MAX_PIXELS else f"Save it in another format than {image.format}."
            raise PhotoError(
                f"{visible(path.name)} has {image.width} x {image.height} pixels, and at most "
                f"{most // 1_000_000} million pixels can be read safely. {advice}"
            )
        full_size = image.size
        if max_side is not None:
            image.draft(None, _size_within(full_size, max_side))
        yield image, full_size


def _identified(stream: IO[bytes], path: Path, kind: str) -> Image.Image:
    """Return the picture of a file of a known kind."""
    try:
        # The content has been looked at: no other decoder is tried.
        return Image.open(stream, formats=(_FORMATS[kind],))
    except Image.UnidentifiedImageError as error:
        if kind == "TIFF":
            problem = "is damaged, or stores its samples in a way that is not read"
            advice = "Save it again as RGB with 8 or 16 bits per channel."
        else:
            problem = f"is a {kind} file that is damaged or cut short and cannot be read"
            advice = "Copy it again from the camera."
        raise PhotoError(f"{visible(path.name)} {problem}. {advice}") from error


def _require_file(path: Path) -> None:
    name = visible(path.name)
    try:
        status = path.stat()
    except FileNotFoundError as error:
        if path.is_symlink():
            raise PhotoError(f"{name} is a link to a file that does not exist. Delete it or mend it.") from error
        raise PhotoError(f"{visible(str(path))} is missing. Restore the photo and run again.") from error
    # ValueError: a null character in the name.
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PhotoError(f"{name} cannot be read: {reason}. Delete it or mend it.") from error
    if stat.S_ISDIR(status.st_mode):
        raise PhotoError(f"{name} is a folder. Rename it.")
    if not stat.S_ISREG(status.st_mode):
        raise PhotoError(f"{name} is not a file: it is a pipe or a device. Delete it.")
    if status.st_size == 0:
        raise PhotoError(f"{name} is empty. Copy it again from the camera.")


def _size_within(size: tuple[int, int], max_side: int) -> tuple[int, int]:
    """Return `size` reduced so that the longest side is at most `max_side`, and each side at least 1."""
    longest = max(size)
    if longest <= max_side:
        return size
    return max(1, round(size[0] * max_side / longest)), max(1, round(size[1] * max_side / longest))


def upright_with_alpha(
    image: Image.Image, *, max_side: int | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return the sRGB pixels of a picture from `open_photo`, and their alpha.

    Parameters
    ----------
    max_side : int, optional
        See `bounded.load_pixels`.

    Returns
    -------
    pixels : uint8 array of shape [H, W, 3]
    alpha : uint8 array of shape [H, W], or None
        None if the file has no alpha.

    Raises
    ------
    PhotoError
        For damaged pictures.

    Notes
    -----
    Colours are converted in strips: copies of a whole picture would take several times its memory.
    """
    transpose = UPRIGHT_TRANSPOSES.get(orientation_of(image))
    full_size = image.info.get("full_size", image.size)
    size = full_size if max_side is None else _size_within(full_size, max_side)
    picture = image if image.size == size else _resized(_eight_bits(image), size, full_size)
    pixels = np.empty((*(size if transpose in _SWAPS_SIDES else size[::-1]), 3), np.uint8)
    alpha: NDArray[np.uint8] | None = None
    top = 0
    for colours, transparency in _converted_strips(picture, image.info):
        rows = slice(top, top + len(colours))
        _as_stored(pixels, transpose)[rows] = colours
        if transparency is not None:
            if alpha is None:
                alpha = np.empty(pixels.shape[:2], np.uint8)
            _as_stored(alpha, transpose)[rows] = transparency
        top = rows.stop
    return pixels, alpha


def upright_strips(image: Image.Image, multiple: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the rows of `upright_with_alpha` in strips, whose height is a multiple of `multiple` except for the last.

    A picture that is stored upright is never copied as a whole.
    """
    if UPRIGHT_TRANSPOSES.get(orientation_of(image)) is None:
        for strip, _ in _converted_strips(image, image.info, multiple):
            yield strip
    else:
        pixels = upright_with_alpha(image)[0]
        height = _strip_height(pixels.shape[1], multiple)
        for top in range(0, len(pixels), height):
            yield pixels[top : top + height]


def _converted_strips(
    picture: Image.Image, info: dict[Any, Any], multiple: int = 1
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8] | None]]:
    """Yield the sRGB pixels of a picture and their alpha in strips of rows; `info` is that of its file."""
    to_rgb: Callable[[Image.Image], Image.Image] | None = None
    for _, strip in strips_of(picture, multiple):
        strip = _eight_bits_of_strip(strip)
        transparency = strip.getchannel("A") if strip.mode == "RGBA" else None
        if transparency is not None:
            strip = strip.convert("RGB")
        to_rgb = to_rgb or _conversion_to_srgb(strip.mode, info)
        strip = to_rgb(strip)
        if transparency is None:
            yield np.asarray(strip), None
        else:
            white = Image.new("RGB", strip.size, (255, 255, 255))
            yield np.asarray(Image.composite(strip, white, transparency)), np.asarray(transparency)


_SWAPS_SIDES = (
    Image.Transpose.TRANSPOSE, Image.Transpose.ROTATE_270, Image.Transpose.TRANSVERSE, Image.Transpose.ROTATE_90
)  # fmt: skip


def _as_stored(upright: NDArray[np.uint8], transpose: Image.Transpose | None) -> NDArray[np.uint8]:
    """Return a view of an upright picture in the orientation of the file, from which `transpose` makes it."""
    if transpose is None:
        return upright
    return {
        Image.Transpose.FLIP_LEFT_RIGHT: upright[:, ::-1],
        Image.Transpose.FLIP_TOP_BOTTOM: upright[::-1],
        Image.Transpose.ROTATE_180: upright[::-1, ::-1],
        Image.Transpose.TRANSPOSE: upright.swapaxes(0, 1),
        Image.Transpose.TRANSVERSE: upright[::-1, ::-1].swapaxes(0, 1),
        Image.Transpose.ROTATE_270: np.rot90(upright, 1),
        Image.Transpose.ROTATE_90: np.rot90(upright, -1),
    }[transpose]


def strips_of(image: Image.Image, multiple: int = 1) -> Iterator[tuple[int, Image.Image]]:
    """Yield the rows of a picture in strips of about a million pixels, each with the number of its first row."""
    height = _strip_height(image.width, multiple)
    for top in range(0, image.height, height):
        yield top, image.crop((0, top, image.width, min(top + height, image.height)))


def _strip_height(width: int, multiple: int) -> int:
    return max(1, _STRIP_PIXELS // (width * multiple)) * multiple


def _resized(picture: Image.Image, size: tuple[int, int], full_size: tuple[int, int]) -> Image.Image:
    # A JPEG with an odd side, decoded at a reduced size, covers slightly more than the photo. The box excludes this
    # fraction of a pixel, so that positions stay exact.
    reduction = 2 ** round(np.log2(full_size[0] / picture.width)) if picture.size != full_size else 1
    box = (0.0, 0.0, min(picture.width, full_size[0] / reduction), min(picture.height, full_size[1] / reduction))
    if picture.mode != "RGBA":
        return picture.resize(size, Image.Resampling.HAMMING, box=box)
    return picture.convert("RGBa").resize(size, Image.Resampling.HAMMING, box=box).convert("RGBA")


def _eight_bits(image: Image.Image) -> Image.Image:
    """Return `image` converted to mode L, RGB, RGBA, CMYK or LAB."""
    if not image.mode.startswith("I"):
        return _eight_bits_of_strip(image)
    reduced = Image.new("L", image.size)
    for top, strip in strips_of(image):
        reduced.paste(_eight_bits_of_strip(strip), (0, top))
    return reduced


def _eight_bits_of_strip(image: Image.Image) -> Image.Image:
    if image.mode.startswith("I"):
        values = np.asarray(image).astype(np.float64)
        # Mode I contains the 16 bits of a gray file; 65535 / 257 = 255 exactly.
        return Image.fromarray(np.clip(np.rint(values / 257.0), 0, 255).astype(np.uint8))
    if image.mode in _NATIVE_MODES:
        # A file can also declare one of its colours as transparent.
        return image.convert("RGBA") if "transparency" in image.info and image.mode in ("L", "RGB") else image
    has_alpha = image.mode in ("LA", "La", "PA", "RGBa") or "transparency" in image.info
    return image.convert("RGBA" if has_alpha else "RGB")


def _conversion_to_srgb(mode: str, info: dict[Any, Any]) -> Callable[[Image.Image], Image.Image]:
    """Return a function from pictures of `mode` to RGB; an ICC profile that is sRGB or does not fit is ignored."""
    profile = info.get("icc_profile")
    if profile:
        try:
            source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
            if "srgb" not in ImageCms.getProfileDescription(source).lower():
                transform = ImageCms.buildTransform(source, _SRGB, mode, "RGB")
                ImageCms.applyTransform(Image.new(mode, (1, 1)), transform)
                return lambda picture: _transformed(picture, transform)
        except (ImageCms.PyCMSError, OSError, ValueError) as error:
            _LOG.warning("A colour profile that does not fit its picture is ignored: %s", error)
    return conversion_of_numbers(info) or (lambda picture: picture.convert("RGB"))


def _transformed(picture: Image.Image, transform: ImageCms.ImageCmsTransform) -> Image.Image:
    converted = ImageCms.applyTransform(picture, transform)
    if converted is None:
        raise AssertionError("applyTransform returns None only with inPlace")
    return converted
