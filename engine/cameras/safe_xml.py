"""XML of other people: a tree of elements, without entities, document types and anything outside of the file."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from ..core.errors import CameraError
from ..core.files import read_bytes

_MAX_BYTES = 128 << 20
_MAX_DEPTH = 64
_MAX_NUMBERS = 64


class _Refused(Exception):
    """A file is unsafe; the message is the reason, as a clause."""


def parsed_xml(file: Path, advice: str) -> ET.Element:
    """Return the root element of an XML file; names are local ones, without their namespaces.

    Raises
    ------
    CameraError
        When it is not well-formed XML, has a document type, or is nested deeper than any export of cameras.
    FormatError
        When it cannot be opened or is larger than 128 MB.
    """
    data = read_bytes(file, max_bytes=_MAX_BYTES, advice=advice)
    builder = ET.TreeBuilder()
    depth = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _MAX_DEPTH:
            raise _Refused("its elements are nested too deeply")
        builder.start(_local(name), {_local(key): value for key, value in attributes.items()})

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(_local(name))

    def refuse(*_: object) -> None:
        raise _Refused("it has a document type, which no export of cameras needs")

    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, builder.data
    # Entities are declared in a document type only.
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return builder.close()
    except _Refused as error:
        raise CameraError(f"{file} cannot be read: {error}. {advice}") from error
    except (expat.ExpatError, AssertionError, ValueError, LookupError) as error:
        raise CameraError(f"{file} cannot be read: it is not whole XML ({error}). {advice}") from error


def _local(name: str) -> str:
    return name.rpartition(" ")[2]


def numbers_of(text: str | None, *counts: int) -> list[float]:
    """Return the numbers of a text, separated by blanks; raises `ValueError` unless it has one of these counts
    of finite numbers."""
    parts = (text or "").split(None, _MAX_NUMBERS)
    if len(parts) not in counts:
        raise ValueError(f"{len(parts)} numbers stand where {' or '.join(map(str, counts))} should")
    numbers = [float(part) for part in parts]
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a number is not finite")
    return numbers
