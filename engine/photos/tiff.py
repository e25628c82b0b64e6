"""The first directory of a TIFF: what it costs to parse, whether it is a raw camera file, and what is not read.

TIFF stores samples in many ways. Those that Pillow decodes wrongly or under the name of another are refused here;
tests compare the others with a second decoder.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import IO, Literal, NamedTuple

TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")

_MAX_TAGS = 4_096
_MAX_PARTS = 100_000
"""Largest number of strips or tiles."""
_MAX_NUMBERS = 16
"""Values of a tag that are looked at: one per sample of a pixel."""
_MAX_SUB_DIRECTORIES = 8

_BITS, _COLOURS, _OFFSETS, _SAMPLES, _PLANES, _TILES = 258, 262, 273, 277, 284, 324
_SUB_DIRECTORIES, _FORMATS, _DNG_VERSION = 330, 339, 50706
_WHITE_IS_ZERO, _BLACK_IS_ZERO = 0, 1
_SENSOR_COLOURS = (32803, 34892)
"""Pixels of a sensor, behind its colour filter or made linear."""
_SEPARATE = 2
_UNSIGNED, _FLOAT, _UNDEFINED = 1, 3, 4
_READ_BITS = (1, 2, 4, 8, 16)
_SIZES = {1: 1, 3: 2, 4: 4, 13: 4, 16: 8, 18: 8}
"""Bytes of a whole number by type."""


class _Entry(NamedTuple):
    tag: int
    kind: int
    n_values: int
    value: bytes
    """The value itself where it fits, else its place in the file."""


class _Directory(NamedTuple):
    stream: IO[bytes]
    order: Literal["little", "big"]
    wide: int
    """Bytes of a place in the file: 4, or 8 in a BigTIFF."""

    def number(self, n_bytes: int) -> int:
        return int.from_bytes(self.stream.read(n_bytes), self.order)


def problem_of_parts(stream: IO[bytes]) -> str | None:
    """Return why parsing the first directory would take too much, as a clause; Pillow reads no other."""
    found = _opened(stream)
    place = found.number(found.wide)
    if place >= size_of(stream):
        return None
    if _n_tags(found, place) > _MAX_TAGS:
        return f"has more than {_MAX_TAGS:,} tags"
    if any(one.tag in (_OFFSETS, _TILES) and one.n_values > _MAX_PARTS for one in _entries(found, place)):
        return f"is divided into more than {_MAX_PARTS:,} parts"
    return None


def is_raw_tiff(stream: IO[bytes]) -> bool:
    """Return whether a TIFF holds the pixels of a sensor: a raw file, whose first picture is often a thumbnail."""
    found = _opened(stream)
    first = _numbers(found, found.number(found.wide))
    if _DNG_VERSION in first or first.get(_COLOURS, (0,))[0] in _SENSOR_COLOURS:
        return True
    inner = (_numbers(found, place) for place in first.get(_SUB_DIRECTORIES, ())[:_MAX_SUB_DIRECTORIES])
    return any(tags.get(_COLOURS, (0,))[0] in _SENSOR_COLOURS for tags in inner)


def problem_of_layout(stream: IO[bytes]) -> str | None:
    """Return why the samples of a TIFF are not read, as a clause; None where they may be."""
    found = _opened(stream)
    tags = _numbers(found, found.number(found.wide))
    bits = tags.get(_BITS, (1,))
    formats = set(tags.get(_FORMATS, (_UNSIGNED,)))
    colours, n_samples = tags.get(_COLOURS, (_WHITE_IS_ZERO,))[0], tags.get(_SAMPLES, (1,))[0]
    if _FLOAT in formats:
        return f"contains {bits[0]}-bit floats, whose range is unknown"
    if formats - {_UNSIGNED, _UNDEFINED}:
        return "contains signed or complex numbers"
    if len(set(bits)) > 1 or bits[0] not in _READ_BITS:
        return f"has {' + '.join(map(str, dict.fromkeys(bits)))} bits per sample"
    if colours == _WHITE_IS_ZERO and bits[0] > 8:
        return f"has {bits[0]} bits per sample in which 0 is white"
    if colours in (_WHITE_IS_ZERO, _BLACK_IS_ZERO) and n_samples > 1 and tags.get(_PLANES, (1,))[0] == _SEPARATE:
        return f"has {n_samples} planes of gray"
    return None


def _opened(stream: IO[bytes]) -> _Directory:
    """Return a reader that stands before the place of the first directory."""
    stream.seek(0)
    start = stream.read(4)
    found = _Directory(stream, "little" if start.startswith(b"II") else "big", 8 if b"+" in start else 4)
    stream.seek(found.wide)
    return found


def size_of(stream: IO[bytes]) -> int:
    """Return the length of an open file in bytes."""
    return os.fstat(stream.fileno()).st_size


def _n_tags(found: _Directory, place: int) -> int:
    found.stream.seek(place)
    return found.number(8 if found.wide == 8 else 2)


def _entries(found: _Directory, place: int) -> Iterator[_Entry]:
    """Yield the entries of the directory at `place`; the stream may be moved between them."""
    n_tags, start = _n_tags(found, place), found.stream.tell()
    for index in range(min(n_tags, _MAX_TAGS)):
        found.stream.seek(start + index * (4 + 2 * found.wide))
        tag, kind, count = found.number(2), found.number(2), found.number(found.wide)
        yield _Entry(tag, kind, count, found.stream.read(found.wide))


def _numbers(found: _Directory, place: int) -> dict[int, tuple[int, ...]]:
    """Return the whole numbers of each tag of the directory at `place`, at most `_MAX_NUMBERS` of each."""
    numbers: dict[int, tuple[int, ...]] = {}
    size = size_of(found.stream)
    if not 0 < place < size:
        return numbers
    for entry in _entries(found, place):
        n_bytes = _SIZES.get(entry.kind)
        if n_bytes is None or entry.n_values == 0:
            continue
        data = entry.value
        count = min(entry.n_values, _MAX_NUMBERS)
        if n_bytes * entry.n_values > found.wide:
            found.stream.seek(min(int.from_bytes(entry.value, found.order), size))
            data = found.stream.read(n_bytes * count)
        parts = [data[at : at + n_bytes] for at in range(0, n_bytes * count, n_bytes)]
        numbers[entry.tag] = tuple(int.from_bytes(part, found.order) for part in parts)
    return numbers
