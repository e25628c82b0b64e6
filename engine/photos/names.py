"""Names of photos: those that cannot be stored or shown are refused, and names of files of one shot are compared."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

from ..core.errors import PhotoError
from ..core.files import problem_of_inner_name
from ..core.visible_text import visible
from ..scene import READ_SUFFIXES

_PICTURE_SUFFIX = re.compile(rf"({'|'.join(map(re.escape, sorted(READ_SUFFIXES)))})$", re.IGNORECASE)
_MASK_WORD = r"(masks?|mattes?|alpha|silhouette|seg|segmentation|labels?)"
_MASK_WORDS = re.compile(rf"^{_MASK_WORD}[-_. ]+|[-_. ]+{_MASK_WORD}$", re.IGNORECASE)


def compared_stem(name: str, *, without_mask_words: bool = False) -> str:
    """Return a file's name without what differs between the files of one shot: its suffix, case and Unicode form.

    Parameters
    ----------
    name : str
        Without its folder.
    without_mask_words : bool
        Also remove what names of masks add: the suffix of the photo, and words such as ``mask``. The masks
        ``photo.jpg.png`` and ``photo_mask.png`` then have the stem of ``photo.jpg``.
    """
    stem = _PICTURE_SUFFIX.sub("", unicodedata.normalize("NFC", name).casefold())
    if without_mask_words:
        stem = stripped_of_mask_words(_PICTURE_SUFFIX.sub("", stem)) or stem
        stem = _PICTURE_SUFFIX.sub("", stem)
    return stem


def stripped_of_mask_words(stem: str) -> str:
    """Return the name of a mask, without its suffix, without words such as ``mask`` at its beginning or end."""
    return _MASK_WORDS.sub("", stem) or stem


def problem_of_name(name: str) -> str | None:
    """Return why a photo cannot be used because of its name, as a sentence; None for a usable name.

    Parameters
    ----------
    name : str
        Relative to the photo folder. It is stored as JSON, written into reports and shown.
    """
    if not _is_utf8(name):
        return "Its name has bytes that are not UTF-8. Rename it."
    if visible(name) != name:
        return "Its name has control characters. Rename it."
    problem = problem_of_inner_name(name)
    return None if problem is None else f"Its name {problem}. Rename it."


def require_utf8_folder(folder: Path) -> None:
    """Raise `PhotoError` when the path of `folder` cannot be stored, because it is not UTF-8."""
    if not _is_utf8(str(folder)) or not _is_utf8(str(folder.resolve())):
        name = visible(str(folder.resolve()))
        raise PhotoError(f"The path of the folder {name} has bytes that are not UTF-8. Rename the folder.")


def _is_utf8(name: str) -> bool:
    # Python represents a byte that is not UTF-8 by a surrogate, which cannot be encoded.
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True
