"""Valid pixels of a photo: those that neither its mask nor its alpha channel excludes.

Masks follow COLMAP's naming, ``MASKS/photo.jpg.png`` for ``photo.jpg``, with sub-folders kept. Black pixels are
excluded, all others are valid. Masks are used to exclude transients, a turntable, a tripod or a reflection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from ..errors import Cancelled, PhotoError
from ..events import Emit, StopCheck, Warned
from ..files import file_sha256
from ..scene import Photo
from .exif import UPRIGHT_TRANSPOSES, orientation_of
from .pixels import open_photo, upright_with_alpha

__all__ = ["load_valid", "load_with_valid", "with_masks"]

Valid = NDArray[np.bool_]

_MIN_ALPHA = 250
"""Smallest alpha of a valid pixel. Pixels with a smaller alpha are blended with the white background."""
_MAX_NAMES_IN_WARNING = 5
_MASK_CHECK_SIDE = 1024
"""Longest side in pixels at which a mask is checked to leave at least one valid pixel."""


def load_with_valid(
    path: Path, mask: Path | None, *, max_side: int | None = None
) -> tuple[NDArray[np.uint8], Valid | None]:
    """Return the pixels of a photo as from `pixels.load_pixels`, and which of them are valid.

    Parameters
    ----------
    path : Path
        The photo.
    mask : Path or None
        Its mask.
    max_side : int, optional
        See `pixels.load_pixels`. A pixel of a reduced picture is valid when all the pixels it is computed from are.

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
    image, _ = open_photo(path, max_side=max_side)
    pixels, alpha = upright_with_alpha(image, max_side=max_side)
    valid = np.ones(pixels.shape[:2], bool) if alpha is None else alpha >= _MIN_ALPHA
    if mask is not None:
        upright = _to_upright(_read_mask(mask), mask, path, image.info["full_size"], orientation_of(image))
        valid &= _reduced(upright, pixels.shape[1], pixels.shape[0])
    return pixels, None if valid.all() else valid


def load_valid(path: Path, mask: Path | None, *, max_side: int | None = None) -> Valid | None:
    """Return which pixels of a photo are valid, see `load_with_valid`."""
    return load_with_valid(path, mask, max_side=max_side)[1]


def with_masks(
    folder: Path, photos: Sequence[Photo], masks: Path, *, emit: Emit, should_stop: StopCheck
) -> tuple[Photo, ...]:
    """Return the photos in `folder` with their masks from the folder `masks`; each mask is checked.

    Parameters
    ----------
    folder : Path
    photos : sequence of Photo
    masks : Path
    emit : Emit
        Receives one warning that lists the photos without a mask; all their pixels are valid.
    should_stop : StopCheck
        Called for each photo.

    Raises
    ------
    PhotoError
        When the folder is missing or contains no mask of any photo, or when a mask cannot be read, differs in size from
        its photo or excludes all of its pixels.
    Cancelled
        When `should_stop` returns True.
    """
    if not masks.is_dir():
        raise PhotoError(f"The mask folder {masks} does not exist. Choose the folder that contains the photos' masks.")
    with_mask, without = [], []
    for photo in photos:
        if should_stop():
            raise Cancelled("Reading the masks was stopped. Nothing was changed.")
        file = masks / f"{photo.name}.png"
        if not file.is_file():
            without.append(photo.name)
            with_mask.append(photo)
            continue
        valid = load_valid(folder / photo.name, file, max_side=_MASK_CHECK_SIDE)
        if valid is not None and not valid.any():
            raise PhotoError(
                f"The mask {file} excludes every pixel of {photo.name}. Remove the photo from its folder, or delete "
                "the mask."
            )
        with_mask.append(replace(photo, mask=str(file.resolve()), mask_sha256=file_sha256(file)))
    if len(without) == len(photos):
        raise PhotoError(
            f"No file in {masks} is a mask of one of the photos. Name each mask after its photo, followed by .png: "
            f"{photos[0].name}.png."
        )
    if without:
        named = ", ".join(without[:_MAX_NAMES_IN_WARNING]) + (
            " and others" if len(without) > _MAX_NAMES_IN_WARNING else ""
        )
        emit(Warned(f"{len(without)} of {len(photos)} photos have no mask in {masks} and are used whole: {named}."))
    return tuple(with_mask)


def _read_mask(mask: Path) -> Valid:
    """Return the mask in its stored orientation, False where it is black."""
    try:
        image, _ = open_photo(mask)
    except PhotoError as error:
        raise PhotoError(f"The mask {mask} cannot be read. Save it again as PNG.") from error
    values = np.asarray(image if image.mode in ("1", "L", "I;16", "I", "RGB") else image.convert("RGB"))
    return np.asarray(values.reshape(*values.shape[:2], -1).any(axis=2), dtype=np.bool_)


def _to_upright(valid: Valid, mask: Path, photo: Path, stored: tuple[int, int], orientation: int) -> Valid:
    """Return the mask upright; `stored` is the photo's width and height before its EXIF `orientation` is applied."""
    size, transpose = (valid.shape[1], valid.shape[0]), UPRIGHT_TRANSPOSES.get(orientation)
    upright = stored[::-1] if orientation >= 5 else stored
    if size == upright and (transpose is None or upright != stored):
        return valid
    if size == stored and transpose is not None:
        # COLMAP applies a mask to the pixels in their stored orientation.
        return np.asarray(Image.fromarray(valid).transpose(transpose))
    raise PhotoError(
        f"The mask {mask} has {size[0]} x {size[1]} pixels, its photo {photo.name} {upright[0]} x {upright[1]}. "
        "Save the mask in the photo's size."
    )


def _reduced(valid: Valid, width: int, height: int) -> Valid:
    """Return the mask in `width` x `height` pixels, True where all pixels of `valid` that contribute are True."""
    if valid.shape == (height, width):
        return valid
    shares = Image.fromarray(valid.astype(np.uint8) * 255).resize((width, height), Image.Resampling.BOX)
    # Photos are reduced with a filter whose support is one pixel wider than a box filter's.
    return np.asarray(shares.filter(ImageFilter.MinFilter(3))) == 255
