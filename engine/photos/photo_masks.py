"""Which pixels of a photo count: those that neither its mask nor its own transparency leaves out.

Masks are named as COLMAP names them, ``MASKS/photo.jpg.png`` for ``photo.jpg`` (folders kept): a black pixel is left
out, every other one counts. People who walk by, a turntable, a tripod or a reflection are left out that way.
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
from ..project_folder import file_sha256
from ..scene import Photo
from .exif import TURNS, orientation_of
from .pixels import open_photo, upright_with_alpha

__all__ = ["load_valid", "load_with_valid", "with_masks"]

Valid = NDArray[np.bool_]

_OPAQUE = 250
"""Alpha from which a pixel counts: what is less is mixed with the white that transparent pixels lie over."""
_MOST_NAMED = 5
_LOOKED_AT = 1024
"""Pixels on the longest side that must leave something of a photo."""


def load_with_valid(
    path: Path, mask: Path | None, *, max_side: int | None = None
) -> tuple[NDArray[np.uint8], Valid | None]:
    """Return the pixels of a photo as of `pixels.load_pixels`, and which of them count.

    Parameters
    ----------
    path : Path
        The photo.
    mask : Path or None
        Its mask.
    max_side : int, optional
        See `pixels.load_pixels`. A pixel of a smaller picture counts when all that it is made of does.

    Returns
    -------
    pixels : array of shape [H, W, 3], uint8
    valid : bool array of shape [H, W], or None
        None when all count.

    Raises
    ------
    PhotoError
        When photo or mask cannot be read, or their sizes differ.
    """
    image, _ = open_photo(path, max_side=max_side)
    pixels, alpha = upright_with_alpha(image, max_side=max_side)
    valid = np.ones(pixels.shape[:2], bool) if alpha is None else alpha >= _OPAQUE
    if mask is not None:
        whole = _fitting(_read_mask(mask), mask, path, image.info["full_size"], orientation_of(image))
        valid &= _smaller(whole, pixels.shape[1], pixels.shape[0])
    return pixels, None if valid.all() else valid


def load_valid(path: Path, mask: Path | None, *, max_side: int | None = None) -> Valid | None:
    """Return which pixels of a photo count, see `load_with_valid`."""
    return load_with_valid(path, mask, max_side=max_side)[1]


def with_masks(
    folder: Path, photos: Sequence[Photo], masks: Path, *, emit: Emit, should_stop: StopCheck
) -> tuple[Photo, ...]:
    """Return the photos in `folder` with their masks in the folder `masks`, each read once to see that it fits.

    Parameters
    ----------
    folder : Path
    photos : sequence of Photo
    masks : Path
    emit : Emit
        Gets one warning that names photos without a mask; they are used whole.
    should_stop : StopCheck
        Asked per photo.

    Raises
    ------
    PhotoError
        When the folder is missing or holds a mask of none of the photos, or a mask cannot be read, is of another size
        than its photo or leaves nothing of it.
    Cancelled
        When `should_stop` says so.
    """
    if not masks.is_dir():
        raise PhotoError(f"The mask folder {masks} does not exist. Choose the folder that holds the photos' masks.")
    found, without = [], []
    for photo in photos:
        if should_stop():
            raise Cancelled("Reading the masks was stopped. Nothing was changed.")
        file = masks / f"{photo.name}.png"
        if not file.is_file():
            without.append(photo.name)
            found.append(photo)
            continue
        valid = load_valid(folder / photo.name, file, max_side=_LOOKED_AT)
        if valid is not None and not valid.any():
            raise PhotoError(
                f"The mask {file} leaves nothing of {photo.name}. Take the photo out of its folder, or delete the mask."
            )
        found.append(replace(photo, mask=str(file.resolve()), mask_sha256=file_sha256(file)))
    if len(without) == len(photos):
        raise PhotoError(
            f"No file in {masks} is a mask of one of the photos. Name masks after them, with .png behind: "
            f"{photos[0].name}.png."
        )
    if without:
        named = ", ".join(without[:_MOST_NAMED]) + (" and others" if len(without) > _MOST_NAMED else "")
        emit(Warned(f"{len(without)} of {len(photos)} photos have no mask in {masks} and are used whole: {named}."))
    return tuple(found)


def _read_mask(mask: Path) -> Valid:
    """Return the mask as it is stored: False where it is black."""
    try:
        image, _ = open_photo(mask)
    except PhotoError as error:
        raise PhotoError(f"The mask {mask} cannot be read. Save it again as PNG.") from error
    values = np.asarray(image if image.mode in ("1", "L", "I;16", "I", "RGB") else image.convert("RGB"))
    return np.asarray(values.reshape(*values.shape[:2], -1).any(axis=2), dtype=np.bool_)


def _fitting(valid: Valid, mask: Path, photo: Path, stored: tuple[int, int], orientation: int) -> Valid:
    """Return the mask upright; `stored` is the photo's width and height before EXIF's `orientation` turns it."""
    size, turn = (valid.shape[1], valid.shape[0]), TURNS.get(orientation)
    upright = stored[::-1] if orientation >= 5 else stored
    if size == upright and (turn is None or upright != stored):
        return valid
    if size == stored and turn is not None:
        # As COLMAP reads it: laid over the pixels as they are stored.
        return np.asarray(Image.fromarray(valid).transpose(turn))
    raise PhotoError(
        f"The mask {mask} has {size[0]} x {size[1]} pixels, its photo {photo.name} {upright[0]} x {upright[1]}. "
        "Save the mask in the photo's size."
    )


def _smaller(valid: Valid, width: int, height: int) -> Valid:
    """Return the mask in `width` x `height` pixels; one counts when all of `valid` that it is made of does."""
    if valid.shape == (height, width):
        return valid
    shares = Image.fromarray(valid.astype(np.uint8) * 255).resize((width, height), Image.Resampling.BOX)
    # Photos are made smaller with a filter that reaches a pixel further than a box.
    return np.asarray(shares.filter(ImageFilter.MinFilter(3))) == 255
