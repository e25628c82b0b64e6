"""Photos found by the names that other programs, masks and people give them. Standard library only.

Other programs store other paths of the same photos: with another folder in front, backslashes, another suffix, another
case, another form of Unicode, or ``%20`` or ``_`` for a space. A name is matched with the photo whose path has the
longest end in common with it; a name that several photos fit equally well is matched with none of them.
"""

from __future__ import annotations

import functools
import re
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from urllib.parse import unquote

READ_SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".tif", ".tiff", ".webp", ".heic", ".heif", ".hif"}
)
"""Of pictures that are read as photos."""
RAW_SUFFIXES = frozenset(
    {".cr2", ".cr3", ".nef", ".nrw", ".arw", ".dng", ".raf", ".orf", ".rw2", ".pef", ".srw", ".3fr", ".iiq"}
)
"""Of raw camera files, which are not read."""
OTHER_SUFFIXES = frozenset({".bmp", ".gif", ".avif", ".jxl", ".jp2", ".psd", ".exr", ".hdr"})
"""Of other pictures that are not read."""
_PICTURE_SUFFIX = re.compile(rf"({'|'.join(map(re.escape, sorted(READ_SUFFIXES | RAW_SUFFIXES | OTHER_SUFFIXES)))})$")
_BLANK = re.compile(r"[\s_]+")
_MAX_SHOWN = 3


@dataclass(frozen=True)
class NameMatches:
    """The result of `match_names`.

    Attributes
    ----------
    found : dict of str to str
        The photo of each name that has one, in the order of the names. No photo occurs twice.
    ambiguous : dict of str to tuple of str
        Names that several photos fit equally well, with these photos; and names that fit a photo as well as another
        name does, with this photo.
    """

    found: dict[str, str]
    ambiguous: dict[str, tuple[str, ...]]

    def ambiguity(self) -> str | None:
        """Return one name that was not matched because it is ambiguous, as a clause for a message; None without one."""
        for name, photos in self.ambiguous.items():
            if len(photos) > 1:
                more = " and others" if len(photos) > _MAX_SHOWN else ""
                return f"{name} may be {' or '.join(photos[:_MAX_SHOWN])}{more}"
            same = [other for other, others in self.ambiguous.items() if others == photos]
            return f"{' and '.join(same[:_MAX_SHOWN])} may both be {photos[0]}"
        return None


def match_names(names: Iterable[str], photos: Iterable[str]) -> NameMatches:
    """Return which photo each name means.

    Parameters
    ----------
    names : iterable of str
        Paths or names of pictures, with slashes or backslashes.
    photos : iterable of str
        Names of photos: paths relative to the photo folder.

    Notes
    -----
    Two paths fit when their last parts are equal: literally; else in any case; else without the suffix of a picture;
    else with ``%20``, blanks and underscores taken for the same. Unicode is compared in its composed form (NFC). Of the
    photos that fit, those with the most equal parts at the end of the path are better; then those with nothing left
    over in front, then those that fit by a more literal rule. Folders are compared in any case.
    """
    wanted = {name: _parts(name) for name in names}
    known = {photo: _parts(photo) for photo in photos}
    by_key = defaultdict(list)
    for photo, parts in known.items():
        by_key[_loosest(parts[-1])].append(photo)
    claims: dict[str, dict[str, tuple[int, ...]]] = defaultdict(dict)
    ambiguous: dict[str, tuple[str, ...]] = {}
    for name, parts in wanted.items():
        scores = {photo: _score(parts, known[photo]) for photo in by_key.get(_loosest(parts[-1]), ())}
        best = max(scores.values(), default=())
        fitting = [photo for photo, score in scores.items() if score == best]
        if len(fitting) == 1:
            claims[fitting[0]][name] = best
        elif fitting:
            ambiguous[name] = tuple(sorted(fitting))
    matched = {}
    for photo, claimants in claims.items():
        best = max(claimants.values())
        named = [name for name, score in claimants.items() if score == best]
        if len(named) == 1:
            matched[named[0]] = photo
        else:
            ambiguous |= dict.fromkeys(named, (photo,))
    return NameMatches({name: matched[name] for name in wanted if name in matched}, ambiguous)


def photos_called(name: str, photos: Iterable[str]) -> tuple[str, ...]:
    """Return the photos that `name` may mean, see `match_names`: none, one, or several that fit equally well."""
    matches = match_names([name], photos)
    return (matches.found[name],) if name in matches.found else matches.ambiguous.get(name, ())


def _parts(path: str) -> list[str]:
    """Return the parts of a path in composed Unicode, at least one."""
    unified = unicodedata.normalize("NFC", path).replace("\\", "/")
    return [part for part in unified.split("/") if part not in ("", ".")] or [unified]


def _same(part: str) -> str:
    return part


@functools.lru_cache(maxsize=1 << 16)
def _any_case(part: str) -> str:
    return unicodedata.normalize("NFC", part.casefold())


@functools.lru_cache(maxsize=1 << 16)
def _without_suffix(part: str) -> str:
    return _PICTURE_SUFFIX.sub("", _any_case(part.strip()))


@functools.lru_cache(maxsize=1 << 16)
def _loosest(part: str) -> str:
    return _BLANK.sub("_", _without_suffix(unquote(part)))


_RULES: tuple[Callable[[str], str], ...] = (_same, _any_case, _without_suffix, _loosest)
"""How last parts are compared, the most literal rule first."""


def _score(name: list[str], photo: list[str]) -> tuple[int, ...]:
    """Return how well two paths fit whose last parts are equal by the loosest rule; larger is better."""
    length = 1
    while length < min(len(name), len(photo)) and _any_case(name[-length - 1]) == _any_case(photo[-length - 1]):
        length += 1
    rule = next(index for index, part in enumerate(_RULES) if part(name[-1]) == part(photo[-1]))
    return length, int(length == len(photo)), int(length == len(name)), -rule
