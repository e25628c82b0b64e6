"""Load the pixels of a photo, and which of them are valid, within bounds of memory and time (`bounded`).

A pixel is valid when neither the photo's mask nor its alpha channel excludes it. Black pixels of a mask are excluded,
all others are valid. A mask says that a pixel is not known, transparency that nothing is there: features are found
where a photo is opaque, and training learns that the rest is empty.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from ..core.arrays import Mask
from ..core.errors import PhotoError
from ..core.files import ArraySpec, atomic_write, read_array
from ..core.visible_text import visible
from .bounded import call_in_child, is_large, reserved
from .exif import UPRIGHT_TRANSPOSES, orientation_of
from .pixels import (
    PhotoHeader,
    open_photo,
    opened_picture,
    photo_errors,
    read_header,
    strips_of,
    upright_with_alpha,
)

_MIN_ALPHA = 250
"""Smallest alpha of a valid pixel. Pixels with a smaller alpha are blended with the white background."""
_EMPTY_MARGIN = 0.004
"""Width of the margin around an object in which nothing is said of transparent pixels, as a share of the longest side:
cut-outs are inexact there, and Gaussians that may not reach over the edge darken it."""
_PIXELS_FILE, _VALID_FILE = "pixels.npy", "valid.npy"
_ADVICE = "Run again."


def load_pixels(path: Path, *, max_side: int | None = None) -> NDArray[np.uint8]:
    """Return the pixels of a photo with EXIF rotation applied.

    Parameters
    ----------
    path : Path
        JPEG, PNG, TIFF, WebP or HEIC, whatever its name says.
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
    return load_with_valid(path, None, max_side=max_side)[0]


def load_valid(path: Path, mask: Path | None, *, max_side: int | None = None) -> Mask | None:
    """Return which pixels of a photo are valid, see `load_with_valid`."""
    return load_with_valid(path, mask, max_side=max_side)[1]


def load_with_valid(
    path: Path, mask: Path | None, *, max_side: int | None = None, over_black: bool = False
) -> tuple[NDArray[np.uint8], Mask | None]:
    """Return the pixels of a photo as from `load_pixels`, and which of them are valid.

    Parameters
    ----------
    path : Path
        The photo.
    mask : Path or None
        Its mask.
    max_side : int, optional
        See `load_pixels`. A pixel of a reduced picture is valid when all the pixels it is computed from are.
    over_black : bool
        Composite transparent pixels over black instead of white, and count them as valid, but for a margin around the
        object: before a black background the photo then shows that nothing is there.

    Returns
    -------
    pixels : array of shape [H, W, 3], uint8
    valid : bool array of shape [H, W], or None
        None when all pixels are valid.

    Raises
    ------
    PhotoError
        When photo or mask cannot be read, or their sizes differ.
    """
    headers = [read_header(path, max_side=max_side)]
    if mask is not None:
        headers.append(_header_of_mask(mask))
    with reserved(path, *headers):
        if not is_large(*headers):
            return _decoded(path, mask, max_side, over_black)
        with tempfile.TemporaryDirectory() as folder:
            mask_path = None if mask is None else str(mask)
            has_excluded = call_in_child(
                write_with_valid, path, *headers,
                mask=mask_path, max_side=max_side, over_black=over_black, folder=folder,
            )  # fmt: skip
            pixels = read_array(Path(folder) / _PIXELS_FILE, ArraySpec("uint8", ("h", "w", 3)), advice=_ADVICE)
            if not has_excluded:
                return pixels, None
            return pixels, read_array(Path(folder) / _VALID_FILE, ArraySpec("bool", pixels.shape[:2]), advice=_ADVICE)


def stored_orientation(path: Path) -> int:
    """Return the EXIF orientation of a photo, 1 to 8, without decoding it; 1 for HEIC, whose format turns the pixels.

    Raises
    ------
    PhotoError
        When the file is missing or no picture.
    """
    with photo_errors(path), opened_picture(path, None) as (image, _):
        return orientation_of(image)


def write_with_valid(path: str, mask: str | None, max_side: int | None, over_black: bool, folder: str) -> bool:
    """Write what `load_with_valid` returns to `folder`; return whether a pixel is not valid."""
    pixels, valid = _decoded(Path(path), None if mask is None else Path(mask), max_side, over_black)
    for name, values in ((_PIXELS_FILE, pixels), (_VALID_FILE, valid)):
        if values is not None:
            with atomic_write(Path(folder) / name) as stream:
                np.save(stream, values)
    return valid is not None


def _decoded(
    path: Path, mask: Path | None, max_side: int | None, over_black: bool
) -> tuple[NDArray[np.uint8], Mask | None]:
    with photo_errors(path):
        image, _ = open_photo(path, max_side=max_side)
        pixels, alpha = upright_with_alpha(image, max_side=max_side)
        stored, orientation = image.info["full_size"], orientation_of(image)
        del image
        valid = np.ones(pixels.shape[:2], bool) if alpha is None else alpha >= _MIN_ALPHA
        if alpha is not None and over_black:
            valid |= _empty(alpha)
            pixels -= np.minimum(pixels, 255 - alpha[..., None])
        if mask is not None:
            upright = _to_upright(_read_mask(mask), mask, path, stored, orientation)
            valid &= _reduced(upright, pixels.shape[1], pixels.shape[0])
        return pixels, None if valid.all() else valid


def _empty(alpha: NDArray[np.uint8]) -> Mask:
    """Return which pixels are transparent, without a margin around what is not."""
    width = 2 * max(1, round(_EMPTY_MARGIN * max(alpha.shape))) + 1
    largest = Image.fromarray(alpha)
    # A maximum along both axes in steps of 3 pixels, as Pillow's filter of a large size is slow.
    for _ in range(width // 2):
        largest = largest.filter(ImageFilter.MaxFilter(3))
    return np.asarray(largest) <= 255 - _MIN_ALPHA


def _header_of_mask(mask: Path) -> PhotoHeader:
    try:
        return read_header(mask)
    except PhotoError as error:
        raise _unreadable(mask, error) from error


def _read_mask(mask: Path) -> Mask:
    """Return the mask in its stored orientation, False where it is black."""
    try:
        image, _ = open_photo(mask)
    except PhotoError as error:
        raise _unreadable(mask, error) from error
    valid = np.empty((image.height, image.width), bool)
    for top, strip in strips_of(image):
        values = np.asarray(strip if strip.mode in ("1", "L", "I;16", "I", "RGB") else strip.convert("RGB"))
        valid[top : top + strip.height] = values.reshape(*values.shape[:2], -1).any(axis=2)
    return valid


def _unreadable(mask: Path, error: PhotoError) -> PhotoError:
    return PhotoError(f"The mask {visible(str(mask))} cannot be read: {error}")


def _to_upright(valid: Mask, mask: Path, photo: Path, stored: tuple[int, int], orientation: int) -> Mask:
    """Return the mask upright; `stored` is the photo's width and height before its EXIF `orientation` is applied."""
    size, transpose = (valid.shape[1], valid.shape[0]), UPRIGHT_TRANSPOSES.get(orientation)
    upright = stored[::-1] if orientation >= 5 else stored
    if size == upright and (transpose is None or upright != stored):
        return valid
    if size == stored and transpose is not None:
        # COLMAP applies a mask to the pixels in their stored orientation.
        return np.asarray(Image.fromarray(valid).transpose(transpose))
    raise PhotoError(
        f"The mask {visible(str(mask))} has {size[0]} x {size[1]} pixels, its photo {visible(photo.name)} "
        f"{upright[0]} x {upright[1]}. Save the mask in the photo's size."
    )


def _reduced(valid: Mask, width: int, height: int) -> Mask:
    """Return the mask in `width` x `height` pixels, True where all pixels of `valid` that contribute are True."""
    if valid.shape == (height, width):
        return valid
    shares = Image.fromarray(valid.astype(np.uint8) * 255).resize((width, height), Image.Resampling.BOX)
    # Photos are reduced with a filter whose support is one pixel wider than a box filter's.
    return np.asarray(shares.filter(ImageFilter.MinFilter(3))) == 255
