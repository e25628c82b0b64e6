"""The cost of a file's structure for Pillow's parsers, checked before they run.

A few bytes can make a parser allocate an object, inflate a megabyte or pass over the whole picture. These numbers are
bounded far above what cameras and editors write.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import IO

from ..core.errors import PhotoError
from ..core.files import mapped
from ..core.visible_text import visible
from .tiff import TIFF_STARTS, problem_of_layout, problem_of_parts, size_of

_MAX_JPEG_SEGMENTS = 5_000
_MAX_JPEG_SCANS = 200
"""Largest number of scans and the tables between them. A progressive JPEG has about 10 scans."""
MAX_EXIF_BYTES = 1 << 20
"""Cameras write less than 64 KB. Pillow takes up to 50 times the memory of a tag for its values."""
_MAX_PNG_CHUNKS_BESIDE_DATA = 1_000
_MIN_MEAN_DATA_CHUNK = 512
"""Smallest mean size of a data chunk of PNG in bytes, where there are more than `_MAX_PNG_CHUNKS_BESIDE_DATA`."""
_MAX_PNG_PROFILES = 4
_MAX_WHOLE_FILE_BYTES = 256 << 20
"""Largest file of the formats whose decoders read the whole file into memory: WebP and HEIC."""

_MARKER_IN_SCAN = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")
"""The marker of JPEG behind the compressed data of a scan."""
_START_OF_SCAN, _END_OF_IMAGE, _APP1 = 0xDA, 0xD9, 0xE1
_STARTS_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_READ_PRECISION = 8
"""Bits per sample of the JPEG files that are read."""


def require_usual_structure(stream: IO[bytes], path: Path) -> None:
    """Raise `PhotoError` when parsing the file would take too much; `stream` then stands at its beginning again.

    Damage is not an error here: the parser reports it.
    """
    start = stream.read(12)
    stream.seek(0)
    problem = None
    if start.startswith(b"\xff\xd8"):
        problem = _problem_of_jpeg(stream, path)
    elif start.startswith(b"\x89PNG\r\n\x1a\n"):
        problem = _problem_of_png(stream)
    elif start[:4] in TIFF_STARTS:
        problem = problem_of_parts(stream)
        layout = problem_of_layout(stream)
        if problem is None and layout is not None:
            raise PhotoError(f"{visible(path.name)} {layout}. Save it again as RGB with 8 or 16 bits per channel.")
    elif (start[8:12] == b"WEBP" or start[4:8] == b"ftyp") and size_of(stream) > _MAX_WHOLE_FILE_BYTES:
        problem = f"is larger than {_MAX_WHOLE_FILE_BYTES >> 20} MB, more than can be read safely in its format"
    if problem:
        raise PhotoError(f"{visible(path.name)} {problem}. Save it again as JPEG, PNG or TIFF.")
    stream.seek(0)


def _problem_of_jpeg(stream: IO[bytes], path: Path) -> str | None:
    """Walk the segments before the first scan."""
    stream.seek(2)
    n_exif = 0
    for _ in range(_MAX_JPEG_SEGMENTS):
        head = stream.read(4)
        if len(head) < 4 or head[0] != 0xFF or head[1] == _END_OF_IMAGE:
            return None
        if head[1] == _START_OF_SCAN:
            return "has an unusual number of scans" if _has_many_scans(path, stream.tell() - 4) else None
        if head[1] == 0xFF:  # a fill byte
            stream.seek(-3, os.SEEK_CUR)
            continue
        length = int.from_bytes(head[2:], "big")
        content = stream.tell()
        if head[1] in _STARTS_OF_FRAME:
            precision = stream.read(1)
            if precision and precision[0] > _READ_PRECISION:
                return f"has {precision[0]} bits per sample, and JPEG files are read with {_READ_PRECISION}"
        n_exif += length if head[1] == _APP1 and stream.read(4) == b"Exif" else 0
        if n_exif > MAX_EXIF_BYTES:
            return "has more than 1 MB of EXIF data"
        stream.seek(content + length - 2)
    return f"has more than {_MAX_JPEG_SEGMENTS:,} segments before its picture"


def _problem_of_png(stream: IO[bytes]) -> str | None:
    place, size = 8, size_of(stream)
    n_data = n_others = n_profiles = 0
    while place + 12 <= size:
        stream.seek(place)
        head = stream.read(8)
        kind = head[4:]
        if kind == b"IEND":
            break
        n_data += kind in (b"IDAT", b"fdAT")
        n_others += kind not in (b"IDAT", b"fdAT")
        n_profiles += kind == b"iCCP"
        if n_others > _MAX_PNG_CHUNKS_BESIDE_DATA or n_profiles > _MAX_PNG_PROFILES:
            return "has an unusual number of chunks beside its picture"
        if n_data > _MAX_PNG_CHUNKS_BESIDE_DATA + size // _MIN_MEAN_DATA_CHUNK:
            return "is divided into unusually small chunks"
        place += 12 + int.from_bytes(head[:4], "big")
    return None


def _has_many_scans(path: Path, place: int) -> bool:
    """Return whether the JPEG has too many scans from `place` on.

    Each scan may take a few bytes of the file, and the time for the whole picture.
    """
    with mapped(path, advice="Copy it again from the camera.") as data:
        for _ in range(_MAX_JPEG_SCANS):
            found = _MARKER_IN_SCAN.search(data, place)
            if found is None or found.group()[1] == _END_OF_IMAGE:
                return False
            # A segment has its length behind its marker.
            place = found.end() + int.from_bytes(data[found.end() : found.end() + 2], "big")
    return True
