"""Recognise pictures that are masks of photos: they must not be taken for photos, and can be given as masks."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import PurePosixPath

from .look import Look
from .names import compared_stem

_FOLDER_OF_MASKS = re.compile(r"mask|matte|alpha|silhouette|segment|label", re.IGNORECASE)
_MIN_TWO_VALUED = 0.99
"""Least share of the two most frequent colours of a picture that is a mask whatever its name is."""
_MIN_EXTREME = 0.95
"""Least share of nearly black and white pixels of a picture that is named like a mask; JPEG blurs its edges."""
_MIN_FLAT = 0.97
"""Least share of the 8 most frequent colours in a picture of labels that is named like a mask."""
_MIN_SECOND = 0.002
"""Least share of the pixels that are on the other side."""
_MIN_FLAT_REST = 0.7
"""Least share of the next 7 colours in what the most frequent colour does not cover. A cut-out on white has less."""


def masks_among(looks: Mapping[str, Look]) -> dict[str, str]:
    """Return why pictures that are masks are not used as photos, as a sentence by name.

    A picture of two grey values is a mask. With edges that are blurred, by JPEG or by anti-aliasing, or with one colour
    per object, it is one when its name is that of a photo in another folder, with or without a word such as ``mask``,
    or when its folder is named so.

    Parameters
    ----------
    looks : mapping of str to Look
        The pictures by their name.
    """
    by_stem: dict[str, list[str]] = {}
    for name in looks:
        by_stem.setdefault(compared_stem(PurePosixPath(name).name, without_mask_words=True), []).append(name)
    likely = {name for name, look in looks.items() if _is_mask_like(look)}
    certain = {name for name in likely if _is_two_valued(looks[name])}
    photo_of = {}
    for name in likely:
        stem = compared_stem(PurePosixPath(name).name, without_mask_words=True)
        photo_of[name] = next((other for other in by_stem[stem] if other not in likely and other != name), None)
    masks = {
        name
        for name in likely
        if name in certain or photo_of[name] is not None or _FOLDER_OF_MASKS.search(PurePosixPath(name).parent.name)
    }
    # Masks that exclude nothing or everything, among others.
    folders = {PurePosixPath(name).parent for name in masks}
    for name, look in looks.items():
        is_flat = max(look.dark_share, look.bright_share) > 1.0 - _MIN_SECOND and look.gray_share > _MIN_EXTREME
        if name not in masks and is_flat and PurePosixPath(name).parent in folders:
            masks.add(name)
    return {name: _reason(photo_of.get(name)) for name in sorted(masks)}


def summary_of_masks(reasons: Mapping[str, str]) -> str | None:
    """Return one sentence that offers the masks which `masks_among` found; None without masks."""
    if not reasons:
        return None
    folders = sorted({PurePosixPath(name).parent.as_posix() for name in reasons})
    where = ", ".join("the folder itself" if folder == "." else folder for folder in folders)
    return (
        f"{len(reasons)} pictures in {where} look like masks and are not used as photos. If black in them marks what "
        "is to be left out, give their folder as the photos' masks: --photo-masks, or Masks in the import of Blender."
    )


def _reason(photo: str | None) -> str:
    return "It looks like a mask, not like a photo." if photo is None else f"It looks like a mask of {photo}."


def _is_two_valued(look: Look) -> bool:
    shares = look.colour_shares
    return (
        len(shares) >= 2
        and shares[0] + shares[1] >= _MIN_TWO_VALUED
        and shares[1] >= _MIN_SECOND
        and look.gray_share >= _MIN_TWO_VALUED
    )


def _is_mask_like(look: Look) -> bool:
    is_extreme = (
        look.gray_share >= _MIN_EXTREME
        and look.dark_share + look.bright_share >= _MIN_EXTREME
        and min(look.dark_share, look.bright_share) >= _MIN_SECOND
    )
    first, rest = look.colour_shares[0], sum(look.colour_shares[1:])
    is_flat = first + rest >= _MIN_FLAT and rest >= max(_MIN_SECOND, _MIN_FLAT_REST * (1.0 - first))
    return is_extreme or is_flat or _is_two_valued(look)
