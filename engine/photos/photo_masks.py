"""Find and check the masks of photos.

A mask is a picture that is named after its photo: ``photo.jpg.png`` as in COLMAP, ``photo.png``, ``photo_mask.png`` as
in Metashape, in any format and with or without a word such as ``mask``. Photo and mask are matched by
`engine.scene.match_names`, with their sub-folders. Black pixels are excluded, all others are valid. Masks are used to
exclude transients, a turntable, a tripod or a reflection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..core.errors import Cancelled, PhotoError
from ..core.events import Emit, StopCheck, Warned
from ..core.files import file_sha256, problem_of_inner_name
from ..scene import Photo, match_names
from .loading import load_valid
from .names import require_utf8_folder, stripped_of_mask_words

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
    emit : Emit
        Receives one warning that lists the photos without a mask; all their pixels are valid.
    should_stop : StopCheck
        Called for each photo.

    Raises
    ------
    PhotoError
        When the folder is missing or contains no mask of any photo, when a mask may belong to several photos or a photo
        to several masks, or when a mask cannot be read, differs in size from its photo or excludes all of its pixels.
    Cancelled
        When `should_stop` returns True.
    """
    if not masks.is_dir():
        raise PhotoError(f"The mask folder {masks} does not exist. Choose the folder that contains the photos' masks.")
    require_utf8_folder(masks)
    files = _masks_of(masks, [photo.name for photo in photos])
    with_mask, without = [], []
    for photo in photos:
        if should_stop():
            raise Cancelled("Reading the masks was stopped. Nothing was changed.")
        file = files.get(photo.name)
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
        shown = next((path.name for path in sorted(masks.rglob("*.png"))), None)
        raise PhotoError(
            f"No file in {masks} is a mask of one of the photos{f' (one is {shown})' if shown else ''}. Name each mask "
            f"after its photo, followed by .png: {photos[0].name}.png."
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


def _masks_of(masks: Path, photos: Sequence[str]) -> dict[str, Path]:
    """Return the mask files by the photos that have one; raises `PhotoError` when it is not clear whose masks are."""
    problems = {photo: problem_of_inner_name(f"{photo}.png") for photo in photos}
    possible = {photo: masks / f"{photo}.png" for photo, problem in problems.items() if problem is None}
    named = {photo: file for photo, file in possible.items() if file.is_file()}
    others: dict[str, Path] = {}
    twins: dict[str, Path] = {}
    for file in mask_files(masks):
        if file not in named.values():
            photo = _named_photo(file.relative_to(masks))
            (twins if photo in others else others)[photo] = file
    matches = match_names(others, [photo for photo in photos if photo not in named])
    if problem := matches.ambiguity():
        raise PhotoError(
            f"The masks in {masks} do not say which photos they are of: {problem}. Give each mask the name of its "
            f"photo with its folder, followed by .png: {photos[0]}.png."
        )
    if twin := next((name for name in matches.found if name in twins), None):
        raise PhotoError(f"{others[twin]} and {twins[twin]} are masks of one photo. Delete one of them.")
    found = {**named, **{photo: others[name] for name, photo in matches.found.items()}}
    for photo, problem in problems.items():
        if problem is not None and photo not in found:
            raise PhotoError(f"The name of the mask of {photo} {problem}. Give the photo a shorter name.")
    return found


def _named_photo(mask: Path) -> str:
    """Return the name of a mask without its suffix and without what a program added to it."""
    return (mask.parent / stripped_of_mask_words(mask.stem)).as_posix()
