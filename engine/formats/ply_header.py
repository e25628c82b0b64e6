"""Headers of PLY files: elements, their properties and their comments, and the checks that need no row."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from ..core.errors import FormatError

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_MAX_HEADER = 1 << 20
"""Bytes. A longer header is taken for damage."""
_MAX_HEADER_LINES = 10_000
_MAX_PROPERTIES = 1000


@dataclass
class Element:
    """One element of a PLY file, for instance its vertices."""

    name: str
    count: int
    properties: dict[str, str] = field(default_factory=dict)
    """NumPy type of each property that is no list."""
    n_properties: int = 0
    has_lists: bool = False

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Type of a row."""
        return np.dtype(list(self.properties.items()))


@dataclass(frozen=True)
class Header:
    """What stands before the rows of a PLY file.

    Attributes
    ----------
    lines : tuple of str
        As they are in the file, without ``ply`` and ``end_header``.
    elements : tuple of Element
        In the order of their rows.
    """

    lines: tuple[str, ...]
    elements: tuple[Element, ...]

    @classmethod
    def of(cls, lines: Sequence[str], path: Path) -> Header:
        """Return the header with these lines; raises `FormatError` that names `path` when they are damaged."""
        return cls(tuple(lines), tuple(_elements(list(lines), path)))


def read_header(stream: IO[bytes], path: Path, advice: str) -> Header:
    """Return the header of the PLY file `path`; `stream` then stands at its first row.

    Raises
    ------
    FormatError
        When the file is no binary PLY, or its header is damaged; `advice` says what to do then.
    """
    if stream.readline(64).strip() != b"ply":
        raise FormatError(f"{path} is not a PLY file. Choose a Gaussian scene saved as .ply.")
    lines: list[str] = []
    while True:
        raw = stream.readline(_MAX_HEADER)
        if not raw or stream.tell() > _MAX_HEADER or len(lines) > _MAX_HEADER_LINES:
            raise FormatError(f"{path} is not a readable PLY file: its header does not end. {advice}")
        line = raw.decode("utf-8", "replace").strip()
        if line == "end_header":
            break
        lines.append(line)
    return Header.of(lines, path)


def _elements(lines: list[str], path: Path) -> list[Element]:
    order = _byte_order(lines, path)
    elements: list[Element] = []
    for line in lines:
        words = line.split()
        try:
            if words[:1] == ["element"]:
                elements.append(Element(words[1], _count(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].has_lists = True
            elif words[:1] == ["property"]:
                elements[-1].properties[words[2]] = order + _TYPES[words[1]]
                elements[-1].n_properties += 1
        except (IndexError, KeyError, ValueError) as error:
            raise FormatError(
                f"{path} has a PLY header line that cannot be read: `{line[:80]}`. Export it again."
            ) from error
    names = [element.name for element in elements]
    if len(set(names)) < len(names) or any(len(one.properties) < one.n_properties for one in elements):
        raise FormatError(f"{path} has a PLY header that lists an element or a property twice. Export it again.")
    if any(one.n_properties > _MAX_PROPERTIES for one in elements):
        raise FormatError(f"{path} has more than {_MAX_PROPERTIES} properties in one element. Export it again.")
    return elements


def _count(word: str) -> int:
    """Return a count of elements; raises `ValueError` for text, a negative number, or one that no file can have."""
    if not (word.isascii() and word.isdecimal() and len(word) <= 15):
        raise ValueError(word)
    return int(word)


def _byte_order(lines: list[str], path: Path) -> str:
    for line in lines:
        if line.startswith("format"):
            if "binary_little_endian" in line:
                return "<"
            if "binary_big_endian" in line:
                return ">"
            raise FormatError(
                f"{path} is an ASCII PLY file, as point clouds and meshes often are; Gaussian scenes are binary. "
                "Choose a 3DGS PLY, or save it as binary PLY if it is one."
            )
    raise FormatError(f"{path} is not a readable PLY file: it states no format. Export it again.")


def skip_to(stream: IO[bytes], header: Header, name: str, path: Path, size: int, advice: str) -> Element:
    """Return the element `name`; the stream, of `size` bytes, which stood at the first row, then stands at its rows.

    Raises
    ------
    FormatError
        When the element is missing, rows before it have no fixed size, or the file ends before it.
    """
    names = [element.name for element in header.elements]
    before = header.elements[: names.index(name)] if name in names else ()
    wanted = header.elements[len(before)] if name in names else None
    # The rows of a list have no fixed size.
    if wanted is None or any(element.has_lists for element in (*before, wanted)):
        raise FormatError(
            f"{path} contains no Gaussians: it has no plain `{name}` element. Choose a standard 3DGS PLY."
        )
    for element in before:
        n_bytes = element.count * element.dtype.itemsize
        if n_bytes > size - stream.tell():
            raise FormatError(
                f"{path} is truncated: its header states {element.count} rows of `{element.name[:40]}`. {advice}"
            )
        stream.seek(n_bytes, os.SEEK_CUR)
    return wanted


def require_rows(stream: IO[bytes], element: Element, path: Path, size: int, advice: str) -> None:
    """Raise `FormatError` unless all rows of `element`, at which the stream of `size` bytes stands, are there."""
    complete = (size - stream.tell()) // element.dtype.itemsize
    if complete < element.count:
        what = "Gaussians" if element.name == "vertex" else f"rows of `{element.name[:40]}`"
        raise FormatError(
            f"{path} is truncated: its header states {element.count} {what} and it has {complete}. {advice}"
        )
