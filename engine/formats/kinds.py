"""The formats of files with Gaussians that are read, recognised by their content, and one reader for all of them.

A PLY has numbers and properties of its own that are kept: `read_ply_file`. USD is read by the engine alone: `read_usd`.
"""

from __future__ import annotations

from pathlib import Path

from ..core.errors import FormatError
from ..core.files import opened
from ..scene import Gaussians
from .axes import Up
from .glb import read_glb
from .ksplat import read_ksplat
from .sog import DecodePicture, read_sog
from .splat import read_splat
from .spz import read_spz

__all__ = ["READ_SUFFIXES", "kind_of", "read_other"]

_BY_START = {b"ply": "ply", b"glTF": "glb", b"\x1f\x8b": "spz", b"NGSP": "spz", b"PK": "sog", b"{": "sog"}
"""The first bytes of files. KSPLAT and SPLAT have none that are sure, and go by their names."""
_BY_NAME = {".splat": "splat", ".ksplat": "ksplat"}
READ_SUFFIXES = (".ply", ".spz", ".glb", ".sog", ".json", ".splat", ".ksplat")
"""Ends of the names of files that `kind_of` may recognise; ``.json`` is the description of a SOG that is not zipped."""


def kind_of(path: Path) -> str:
    """Return which format a file has, by its content: ``ply``, ``spz``, ``glb``, ``sog``, ``splat`` or ``ksplat``.

    Raises
    ------
    FormatError
        When it cannot be read or has none of these formats.
    """
    with opened(path, advice="Check the path and its permissions.") as stream:
        start = stream.read(4)
    kind = next((kind for first, kind in _BY_START.items() if start.startswith(first)), None)
    kind = kind or _BY_NAME.get(path.suffix.lower())
    # What is empty or damaged is named by its reader.
    suffix = path.suffix.lower()
    kind = kind or (suffix[1:] if suffix in READ_SUFFIXES and suffix != ".json" else None)
    if kind is None:
        raise FormatError(f"{path} is none of PLY, SPZ, GLB, SOG, SPLAT and KSPLAT. Export it as one of these.")
    return kind


def read_other(path: Path, kind: str, decode: DecodePicture, *, up: Up | None = None) -> Gaussians:
    """Return the Gaussians of a file that is no PLY, in the engine's world (Z up).

    Parameters
    ----------
    path : Path
    kind : str
        Of `kind_of`.
    decode : callable
        Decodes the pictures of SOG.
    up : {"z", "-y", "y"}, optional
        Axis of the file that points up. None: Y for SPZ, as its description says, -Y for SOG, SPLAT and KSPLAT, as in
        the files of most programs. GLB defines it.

    Raises
    ------
    HeritageError
        See the readers.
    """
    if kind == "glb":
        return read_glb(path)
    if kind == "sog":
        return read_sog(path, decode, up=up)
    return {"spz": read_spz, "splat": read_splat, "ksplat": read_ksplat}[kind](path, up=up)
