"""Find and check the masks of photos.

Masks follow COLMAP's naming, ``MASKS/photo.jpg.png`` for ``photo.jpg``, with sub-folders kept. Where this file is
missing, a picture in the folder or its sub-folders with the photo's name is its mask, in any format, and with or
without a word such as ``mask``. Black pixels are excluded, all others are valid. Masks are used to exclude transients,
a turntable, a tripod or a reflection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

from ..errors import Cancelled, PhotoError
from ..events import Emit, StopCheck, Warned
from ..files import file_sha256, problem_of_inner_name
from ..scene import Photo
from .loading import load_valid
from .names import compared_stem, require_utf8_folder

__all__ = ["mask_files", "with_masks"]

_MAX_NAMES_IN_WARNING = 5
_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp"})
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
        When the folder is missing or contains no mask of any photo, when two files can be the mask of a photo, or when
        a mask cannot be read, differs in size from its photo or excludes all of its pixels.
    Cancelled
        When `should_stop` returns True.
    """
    if not masks.is_dir():
        raise PhotoError(f"The mask folder {masks} does not exist. Choose the folder that contains the photos' masks.")
    require_utf8_folder(masks)
    others = _by_stem(masks)
    with_mask, without = [], []
    for photo in photos:
        if should_stop():
            raise Cancelled("Reading the masks was stopped. Nothing was changed.")
        file = _mask_of(photo.name, masks, others)
        if file is None:
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


def mask_files(masks: Path) -> list[Path]:
    """Return the pictures in a folder of masks and its sub-folders, ordered by path; none where it does not exist."""
    found = (path for path in masks.rglob("*") if path.suffix.lower() in _SUFFIXES and not path.name.startswith("."))
    return sorted(path for path in found if path.is_file())


def _by_stem(masks: Path) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for path in mask_files(masks):
        found.setdefault(compared_stem(path.name, without_mask_words=True), []).append(path)
    return found


def _mask_of(name: str, masks: Path, others: dict[str, list[Path]]) -> Path | None:
    """Return the mask of a photo; None without one."""
    exact, problem = masks / f"{name}.png", problem_of_inner_name(f"{name}.png")
    if problem is None and exact.is_file():
        return exact
    photo = PurePosixPath(name)
    named = others.get(compared_stem(photo.name, without_mask_words=True), [])
    folders = photo.parent.parts
    shared = [_n_equal_last(path.relative_to(masks).parent.parts, folders) for path in named]
    best = [path for path, n in zip(named, shared, strict=True) if n == max(shared)]
    if len(best) > 1:
        raise PhotoError(f"Both {best[0]} and {best[1]} can be the mask of {name}. Keep the one that is.")
    if not best and problem is not None:
        raise PhotoError(f"The name of the mask of {name} {problem}. Give the photo a shorter name.")
    return best[0] if best else None


def _n_equal_last(first: Sequence[str], second: Sequence[str]) -> int:
    """Return how many folders at the end of two paths are the same."""
    n = 0
    for one, other in zip(reversed(first), reversed(second), strict=False):
        if one != other:
            break
        n += 1
    return n
