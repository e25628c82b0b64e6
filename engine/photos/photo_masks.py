"""Find and check the masks of photos.

Masks follow COLMAP's naming, ``MASKS/photo.jpg.png`` for ``photo.jpg``, with sub-folders kept. Black pixels are
excluded, all others are valid. Masks are used to exclude transients, a turntable, a tripod or a reflection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..errors import Cancelled, PhotoError
from ..events import Emit, StopCheck, Warned
from ..files import file_sha256, problem_of_inner_name
from ..scene import Photo
from .loading import load_valid
from .names import require_utf8_folder

__all__ = ["with_masks"]

_MAX_NAMES_IN_WARNING = 5
_MASK_CHECK_SIDE = 1024
"""Longest side in pixels at which a mask is checked to leave at least one valid pixel."""


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
    require_utf8_folder(masks)
    with_mask, without = [], []
    for photo in photos:
        if should_stop():
            raise Cancelled("Reading the masks was stopped. Nothing was changed.")
        name = f"{photo.name}.png"
        problem = problem_of_inner_name(name)
        if problem is not None:
            raise PhotoError(f"The name of the mask of {photo.name} {problem}. Give the photo a shorter name.")
        file = masks / name
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
