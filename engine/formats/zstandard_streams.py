"""Unpacking of Zstandard, which SPZ 4 uses: by the standard library from Python 3.14 on, otherwise by `zstandard`.

Blender brings the package `zstandard`, for its own files; the engine installs it on request (requirements/formats.txt).
"""

from __future__ import annotations

import sys

from ..core.errors import EnvironmentProblem

_PIECE = 1 << 20
_LEAST_WINDOW = 1 << 27
"""Bytes that a stream may look back at without asking for more: the standard's recommendation for decoders."""


def unpack_zstandard(packed: bytes, size: int, otherwise: str) -> bytearray:
    """Return the `size` bytes of a Zstandard stream; no more is unpacked.

    Raises
    ------
    ValueError
        When the stream is damaged, or has another number of bytes.
    EnvironmentProblem
        When nothing here unpacks Zstandard; `otherwise` says what else to do.
    """
    # As the type checker sees it: the module exists from Python 3.14 on.
    content = _by_library(packed, size) if sys.version_info >= (3, 14) else _by_package(packed, size, otherwise)
    if len(content) != size:
        raise ValueError(f"a part has {len(content)} or more bytes instead of {size}")
    return content


def _by_library(packed: bytes, size: int) -> bytearray:
    import importlib

    zstd = importlib.import_module("compression.zstd")
    unpacker = zstd.ZstdDecompressor(
        options={zstd.DecompressionParameter.window_log_max: _window(size).bit_length() - 1}
    )
    content = bytearray()
    try:
        while len(content) <= size and not unpacker.eof:
            piece = unpacker.decompress(packed if not content else b"", max_length=min(_PIECE, size + 1 - len(content)))
            if not piece:
                break
            content += piece
    except zstd.ZstdError as error:
        raise ValueError(str(error)) from error
    return content


def _by_package(packed: bytes, size: int, otherwise: str) -> bytearray:
    try:
        import zstandard
    except ImportError as error:
        raise EnvironmentProblem(
            "SPZ 4 needs the package zstandard, which is not installed. Install requirements/formats.txt with pip, "
            f"{otherwise}."
        ) from error
    content = bytearray()
    try:
        with zstandard.ZstdDecompressor(max_window_size=_window(size)).stream_reader(packed) as stream:
            while len(content) <= size:
                piece = stream.read(min(_PIECE, size + 1 - len(content)))
                if not piece:
                    break
                content += piece
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error
    return content


def _window(size: int) -> int:
    return max(_LEAST_WINDOW, 1 << size.bit_length())
