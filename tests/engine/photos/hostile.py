"""Files that cost far more to read than their size suggests, written without decoding anything."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"


def chunk(kind: bytes, data: bytes) -> bytes:
    """Return a chunk of PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def header(width: int, height: int) -> bytes:
    """Return the start of an RGB picture."""
    return SIGNATURE + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))


def write_large_png(path: Path, width: int, height: int, *, seed: int) -> None:
    """Write a picture of equal rows in a small part of its size."""
    row = b"\0" + np.random.default_rng(seed).integers(0, 255, (width, 3), dtype=np.uint8).tobytes()
    compressor = zlib.compressobj(1)
    data = b"".join(compressor.compress(row) for _ in range(height)) + compressor.flush()
    path.write_bytes(header(width, height) + chunk(b"IDAT", data) + chunk(b"IEND", b""))


def png_with(extra: bytes, *, data_before: bytes = b"") -> bytes:
    """Return a valid picture of 200 x 200 pixels with `extra` chunks before its data."""
    pixels = chunk(b"IDAT", data_before + zlib.compress(bytes(601) * 200))
    return header(200, 200) + extra + pixels + chunk(b"IEND", b"")


def tiff(tags: list[tuple[int, int, int, int]]) -> bytes:
    """Return a little-endian TIFF of one directory with (tag, type, count, value) entries."""
    entries = b"".join(struct.pack("<HHLL", *tag) for tag in tags)
    return b"II*\0" + struct.pack("<LH", 8, len(tags)) + entries + struct.pack("<L", 0)
