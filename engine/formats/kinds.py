"""The formats of files with Gaussians that are read, recognised by their content, and one reader for all of them.

A PLY has numbers and properties of its own that are kept: `read_ply_file`. USD is read by the engine alone: `read_usd`.
"""

from __future__ import annotations

from pathlib import Path

from ..core.errors import FormatError
from ..core.files import opened
from ..scene import Gaussians
from .axes import Up
from .sog import DecodePicture
from .table import FORMATS, format_of

_READ = tuple(one for one in FORMATS if one.read is not None)
READ_SUFFIXES = tuple(suffix for one in _READ for suffix in (*one.suffixes, *one.read_suffixes))
"""Ends of the names of files that `kind_of` may recognise."""


def kind_of(path: Path) -> str:
    """Return the name of the format of a file, by its content or, where that is not sure, by its name.

    Raises
    ------
    FormatError
        When it cannot be read or has none of the formats that are read.
    """
    with opened(path, advice="Check the path and its permissions.") as stream:
        start = stream.read(4)
    suffix = path.suffix.lower()
    for kind in _READ:
        if any(start.startswith(first) for first in kind.starts):
            return kind.name
    # What is empty or damaged is named by its reader.
    for kind in _READ:
        if suffix in kind.suffixes:
            return kind.name
    *names, last = (kind.label for kind in _READ)
    raise FormatError(f"{path} is none of {', '.join(names)} and {last}. Export it as one of these.")


def read_other(path: Path, kind: str, decode: DecodePicture, *, up: Up | None = None) -> Gaussians:
    """Return the Gaussians of a file, in the engine's world (Z up).

    Parameters
    ----------
    kind : str
        Of `kind_of`.
    decode : callable
        Decodes the pictures of SOG.
    up : {"z", "-y", "y"}, optional
        Axis of the file that points up. None: Y for SPZ, as its description says, -Y for SOG, SPLAT and KSPLAT, as in
        the files of most programs. GLB defines it.

    Raises
    ------
    FormatError
        When nothing here reads this kind, or the file is damaged; see the readers.
    """
    read = format_of(kind).read
    if read is None:
        raise FormatError(f"{path} is {format_of(kind).label}, which is not read here. Export it in another format.")
    return read(path, decode, up)
