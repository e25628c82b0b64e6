"""What binary files of glTF 2.0 share, of Gaussians and of meshes: what they say of themselves, and their parts."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .. import __version__
from ..core.errors import FormatError
from ..core.files import atomic_write
from .facts import FileFacts

MAGIC, JSON_CHUNK, BIN_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
FLOAT, USHORT, UINT, ARRAY_BUFFER, INDEX_BUFFER = 5126, 5123, 5125, 34962, 34963
XMP = "KHR_xmp_json_ld"
MAX_FILE_SIZE = 2**32 - 1
"""Bytes; the header of a GLB states its size as a 32 bit number."""


def document_of(facts: FileFacts) -> dict[str, Any]:
    """Return a JSON part with one node, and with the rights, the record and its XMP in ``asset``."""
    asset: dict[str, Any] = {"version": "2.0", "generator": f"Gaussian Heritage {__version__}"}
    if facts.rights:
        asset["copyright"] = facts.rights
    if facts.extras:
        asset["extras"] = dict(facts.extras)
    document: dict[str, Any] = {"asset": asset, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"name": facts.name}]}
    if facts.xmp is not None:
        asset["extensions"] = {XMP: {"packet": 0}}
        document |= {"extensionsUsed": [XMP], "extensions": {XMP: {"packets": [dict(facts.xmp)]}}}
    return document


def write_parts(
    path: Path, document: dict[str, Any], binary: Iterable[bytes | bytearray | memoryview], n_bytes: int, otherwise: str
) -> None:
    """Write a GLB atomically: its JSON part and its binary part of `n_bytes`, a multiple of 4, which may be 0.

    Raises
    ------
    FormatError
        When the file would exceed 4 GiB, the limit of GLB; `otherwise` says what else to do.
    DiskError
        When the file cannot be written.
    """
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + (8 + n_bytes if n_bytes else 0)
    if total > MAX_FILE_SIZE:
        raise FormatError(f"{path} would take {total / 2**30:.1f} GiB; GLB is limited to 4 GiB. {otherwise}")
    with atomic_write(path) as stream:
        stream.write(struct.pack("<IIIII", MAGIC, 2, total, len(text), JSON_CHUNK) + text)
        if n_bytes:
            stream.write(struct.pack("<II", n_bytes, BIN_CHUNK))
            stream.writelines(binary)
