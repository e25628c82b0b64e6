"""The kind of a file by its first bytes. Its name says nothing: programs deliver JPEG files called .HEIC."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import IO

from ..core.errors import HeritageError
from ..core.files import opened
from ..scene import OTHER_SUFFIXES, RAW_SUFFIXES, READ_SUFFIXES
from .settings import VIDEO_SUFFIXES
from .tiff import TIFF_STARTS, is_raw_tiff

HEIC, RAW, VIDEO = "HEIC", "raw", "video"
SUFFIXES = {"JPEG": ".jpg", "PNG": ".png", "TIFF": ".tif", "WebP": ".webp", HEIC: ".heic", VIDEO: ".mp4"}
"""Usual suffix of the kinds that are read."""
PICTURES = frozenset(SUFFIXES) - {VIDEO}
"""Kinds of pictures that are read."""

_HEAD_BYTES = 64
_STARTS: tuple[tuple[int, bytes, str], ...] = (
    (0, b"\xff\xd8\xff", "JPEG"),
    (0, b"\x89PNG\r\n\x1a\n", "PNG"),
    (8, b"WEBP", "WebP"),
    (0, b"FUJIFILMCCD-RAW", RAW),
    (0, b"IIRO", RAW),
    (0, b"IIRS", RAW),
    (0, b"MMOR", RAW),
    (0, b"IIU\0", RAW),
    (0, b"\0MRM", RAW),
    (0, b"FOVb", RAW),
    (6, b"HEAPCCDR", RAW),
    (0, b"GIF8", "GIF"),
    (0, b"8BPS", "PSD"),
    (0, b"\x76\x2f\x31\x01", "EXR"),
    (0, b"#?RADIANCE", "HDR"),
    (0, b"#?RGBE", "HDR"),
    (0, b"\xff\x0a", "JXL"),
    (4, b"JXL \r\n\x87\n", "JXL"),
    (4, b"jP  \r\n\x87\n", "JP2"),
    (0, b"\xff\x4f\xff\x51", "JP2"),
    (8, b"AVI ", VIDEO),
    (0, b"\x1a\x45\xdf\xa3", VIDEO),
    (0, b"\0\0\x01\xba", VIDEO),
    (0, b"\x30\x26\xb2\x75\x8e\x66\xcf\x11", VIDEO),
    # QuickTime before it had a list of brands.
    (4, b"moov", VIDEO),
    (4, b"mdat", VIDEO),
    (4, b"wide", VIDEO),
    (4, b"pnot", VIDEO),
)
"""Place, bytes there, kind."""
_HEIC_BRANDS = frozenset({b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"hevm", b"hevs"})
_AVIF_BRANDS = frozenset({b"avif", b"avis"})
_SHARED_BRANDS = frozenset({b"mif1", b"mif2", b"msf1", b"miaf"})
"""Brands of HEIC and AVIF alike; the compatible brands state which it is."""
_AUDIO_BRANDS = frozenset({b"M4A ", b"M4B ", b"M4P "})

_VIDEO_SUFFIXES = frozenset({*VIDEO_SUFFIXES, ".insv"})
_MOVING_SUFFIXES = frozenset({".mov", ".mp4"})
"""Of the moving part of a Live Photo, which has the name of its photo."""


def kind_of_file(path: Path) -> str | None:
    """Return the kind of a file by its content: one of `PICTURES`, ``"raw"``, ``"video"``, or the name of a format of
    pictures that is not read, such as ``"GIF"``. None for anything else, also for what is no file or cannot be opened.
    """
    try:
        with opened(path, advice="Check its permissions.") as stream:
            return kind_of_stream(stream)
    except HeritageError:
        return None


def kind_of_stream(stream: IO[bytes]) -> str | None:
    """Return the kind of an open file as `kind_of_file` does. The stream then stands at its beginning."""
    stream.seek(0)
    head = stream.read(_HEAD_BYTES)
    kind = _kind_of_head(head)
    if kind == "TIFF" and is_raw_tiff(stream):
        kind = RAW
    stream.seek(0)
    return kind


def refusal_of(kind: str | None, suffix: str) -> str | None:
    """Return why a file of this kind is not read as a photo, as a sentence; None where it may be a photo.

    Parameters
    ----------
    kind : str or None
        As of `kind_of_file`.
    suffix : str
        Suffix of its name, which shows what the user takes it for where the content says nothing.
    """
    suffix = suffix.lower()
    if kind == RAW or (kind is None and suffix in RAW_SUFFIXES):
        return "Raw camera files are not read; export it as JPEG or TIFF."
    if kind == VIDEO or (kind is None and suffix in _VIDEO_SUFFIXES):
        return "Videos beside photos are not read; reconstruct the video itself, or add frames of it as JPEG."
    if kind is None and suffix in OTHER_SUFFIXES:
        kind = suffix[1:].upper()
    if kind is not None and kind not in PICTURES:
        return f"{kind} files are not read; save it as JPEG, PNG or TIFF."
    return None


def live_photo_of(name: str, kind: str | None, stills: Iterable[str]) -> str | None:
    """Return the photo that a video is the moving part of, a Live Photo; None where it is a video of its own.

    Parameters
    ----------
    name : str
        Name of the file.
    kind : str or None
        As of `kind_of_file`.
    stills : iterable of str
        Names of the photos in its folder.
    """
    if kind not in (VIDEO, None) or Path(name).suffix.lower() not in _MOVING_SUFFIXES:
        return None
    stem = Path(name).stem.casefold()
    return next((still for still in stills if Path(still).stem.casefold() == stem), None)


def has_suffix_of_picture(name: str) -> bool:
    """Return whether a file of this name is listed as a photo or with a reason, whatever it contains."""
    return Path(name).suffix.lower() in READ_SUFFIXES | RAW_SUFFIXES | _VIDEO_SUFFIXES | OTHER_SUFFIXES


def _kind_of_head(head: bytes) -> str | None:
    if head[:4] in TIFF_STARTS:
        return RAW if head[8:10] == b"CR" or head[8:12] == b"IIII" else "TIFF"
    if head[4:8] == b"ftyp":
        return _kind_of_brands(head)
    # The size of the header behind the file's own, and two numbers that are always 0.
    if (
        head[:2] == b"BM"
        and head[6:10] == bytes(4)
        and head[14:18] in (b"\x0c\0\0\0", b"\x28\0\0\0", b"\x6c\0\0\0", b"\x7c\0\0\0")
    ):
        return "BMP"
    return next((kind for place, mark, kind in _STARTS if head[place : place + len(mark)] == mark), None)


def _kind_of_brands(head: bytes) -> str | None:
    size = min(int.from_bytes(head[:4], "big"), len(head))
    major, brands = head[8:12], {head[at : at + 4] for at in range(16, size - 3, 4)}
    if major in _SHARED_BRANDS:
        return "AVIF" if brands & _AVIF_BRANDS else HEIC
    if major == b"crx ":
        return RAW
    if major in _HEIC_BRANDS:
        return HEIC
    if major in _AVIF_BRANDS:
        return "AVIF"
    if major == b"jxl ":
        return "JXL"
    return None if major in _AUDIO_BRANDS else VIDEO
