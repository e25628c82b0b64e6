"""SPZ, the compressed format of Niantic (https://github.com/nianticlabs/spz): version 3 is written, 2 to 4 are read.

A gzip stream holds a header of 16 bytes, then all positions (fixed point, 24 bits), opacities (8 bits), colours (8),
log-scales (8), rotations (32 bits: the index of the largest component and the three others; 24 bits in version 2) and
spherical harmonics (8 bits, of which 5 are used in degree 1 and 4 above). X is right, Y up and Z back, as in glTF.

Version 4 has a header of 32 bytes that is not compressed, extensions, which are skipped, a table of packed and unpacked
sizes, and a Zstandard stream for each of these fields. Rotations are those of version 3.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..core.files import atomic_write, opened
from ..scene import Gaussians
from .axes import Up
from .bounds import require_memory, upright
from .facts import NO_FACTS, FileFacts
from .origin import require_near
from .ply import check_finite
from .transform import logits_of, transform_gaussians
from .zstandard_streams import unpack_zstandard

_MAGIC, _VERSION = 0x5053474E, 3
_HEADER = struct.Struct("<IIIBBBB")
_ANTIALIASED = 1
"""Flag of Gaussians that were trained anti-aliased."""
_TABLE = struct.Struct("<QQ")
_HEADER_4_BYTES = 32
_MAX_COUNT = 10_000_000
"""Gaussians that readers accept, those of Niantic too."""
_LARGEST = 2**23 - 1
"""Largest step of a position."""
_MOST_FRACTION_BITS = 22
"""Most bits behind the point of a position."""
_STEPS_PER_EXTENT = 2**13
"""Steps between the origin and the place within which 99 % of the Gaussians lie: 0.1 mm for an object of a metre."""
_LEVEL = 5
"""Level of compression: the next one takes twice as long and saves a hundredth."""
_COLOR_SCALE = 0.15
"""Width of a colour coefficient in the range of its 8 bits."""
_SH_STEPS = np.array((8, 16, 16), np.float32)
"""Steps of 1/128 of a coefficient, of degree 1, 2 and 3."""
_GZIP = 16 + zlib.MAX_WBITS
_ROWS_PER_CHUNK = 1 << 14
_CHUNK_BYTES = 1 << 18
_FIELDS = ("positions", "alphas", "colors", "scales", "rotations", "sh")


def write_spz(path: Path, gaussians: Gaussians, facts: FileFacts = NO_FACTS) -> None:
    """Write `gaussians` as SPZ 3 atomically, replacing an existing file.

    Parameters
    ----------
    gaussians : Gaussians
        In the engine's world (Z up). Features are not written.
    facts : FileFacts
        Of these, the transform; the format has no place for the others.

    Raises
    ------
    NumericalError
        When a value is not finite.
    FormatError
        When there are more Gaussians than readers accept, or they lie or are moved too far away.
    DiskError
        When the file cannot be written.
    """
    check_finite(gaussians)
    if len(gaussians) > _MAX_COUNT:
        raise FormatError(
            f"{path} would have {len(gaussians)} Gaussians; SPZ is limited to {_MAX_COUNT}. Export it as PLY or GLB."
        )
    require_near(gaussians, facts.matrix, path)
    turned = transform_gaussians(gaussians, facts.transform("y"))
    fraction_bits = _fraction_bits(turned, path)
    packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, _GZIP)
    with atomic_write(path) as stream:
        flags = _ANTIALIASED if turned.antialiased else 0
        header = _HEADER.pack(_MAGIC, _VERSION, len(turned), turned.sh_degree, fraction_bits, flags, 0)
        stream.write(packer.compress(header))
        for field in _FIELDS:
            for start in range(0, len(turned), _ROWS_PER_CHUNK):
                part = turned[slice(start, start + _ROWS_PER_CHUNK)]
                stream.write(packer.compress(_packed(field, part, fraction_bits)))
        stream.write(packer.flush())


def _fraction_bits(gaussians: Gaussians, path: Path) -> int:
    """Return the bits behind the point of positions: steps are small beside the scene, and the farthest fits."""
    farthest = float(np.abs(gaussians.means).max()) if len(gaussians) else 1.0
    if farthest > _LARGEST:
        raise FormatError(
            f"{path} would have Gaussians {farthest:.3g} units away; SPZ is limited to {_LARGEST}. "
            "Export it as PLY or GLB."
        )
    if farthest == 0:
        return _MOST_FRACTION_BITS
    extent = max(float(np.percentile(np.abs(gaussians.means).max(axis=1), 99)), farthest * 1e-6)
    wanted = int(np.ceil(np.log2(_STEPS_PER_EXTENT / extent)))
    return max(0, min(_MOST_FRACTION_BITS, wanted, int(np.floor(np.log2(_LARGEST / farthest)))))


def _packed(field: str, part: Gaussians, fraction_bits: int) -> bytes:
    """Return the bytes of one field of some Gaussians."""
    if field == "positions":
        steps = np.round(part.means.astype(np.float64) * 2.0**fraction_bits).clip(-_LARGEST, _LARGEST).astype("<i4")
        return np.ascontiguousarray(steps[..., None].view(np.uint8)[..., :3]).tobytes()
    if field == "alphas":
        return _byte(255 * part.opacities).tobytes()
    if field == "colors":
        return _byte(part.sh[:, 0] * (_COLOR_SCALE * 255) + 0.5 * 255).tobytes()
    if field == "scales":
        return _byte((part.log_scales + 10) * 16).tobytes()
    if field == "rotations":
        return _packed_rotations(part.quats).tobytes()
    steps = np.repeat(_SH_STEPS, (3, 5, 7))[: part.sh.shape[1] - 1, None]
    values = np.round(part.sh[:, 1:] * np.float32(128)) + np.float32(128)
    return np.clip(np.floor((values + steps // 2) / steps) * steps, 0, 255).astype(np.uint8).tobytes()


def _byte(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.round(values).clip(0, 255).astype(np.uint8)


def _packed_rotations(quats: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return the index of the largest component of xyzw in 2 bits, and the others: a sign and 9 bits each."""
    xyzw = np.roll(quats.astype(np.float64), -1, axis=1)
    lengths = np.linalg.norm(xyzw, axis=1, keepdims=True)
    xyzw = np.where(lengths > 0, xyzw / np.where(lengths > 0, lengths, 1), (0.0, 0.0, 0.0, 1.0))
    largest = np.abs(xyzw).argmax(axis=1)
    xyzw *= np.where(np.take_along_axis(xyzw, largest[:, None], axis=1) < 0, -1, 1)
    packed = largest.astype(np.uint32)
    for component in range(4):
        value = xyzw[:, component]
        bits = (value < 0).astype(np.uint32) << 9 | np.round(np.abs(value) * (511 * 2**0.5)).clip(0, 511).astype("u4")
        packed = np.where(largest == component, packed, packed << 10 | bits)
    return packed.astype("<u4")


def read_spz(path: Path, *, up: Up | None = None) -> Gaussians:
    """Return the Gaussians of an SPZ file of version 2, 3 or 4, in the engine's world (Z up).

    Parameters
    ----------
    up : {"z", "-y", "y"}, optional
        Axis of the file that points up; by default Y, as the description of the format says. Some programs write -Y.

    Raises
    ------
    EnvironmentProblem
        For version 4, when nothing here unpacks Zstandard.
    FormatError
        When the file cannot be read, is not SPZ, has another version, is truncated or longer than its header states, or
        has values that are too large. Nothing is unpacked beyond what the header states.
    """
    advice = "Copy or export it again."
    with opened(path, advice="Check the path and its permissions.") as stream:
        start = stream.read(4)
        stream.seek(0)
        is_plain = start == struct.pack("<I", _MAGIC)
        if not is_plain and start[:2] != b"\x1f\x8b":
            raise FormatError(f"{path} is not an SPZ file. Choose another file.")
        unpacked: _Unpacked | _Streams = _Streams(stream, path, advice) if is_plain else _Unpacked(stream, path, advice)
        magic, version, count, degree, fraction_bits, flags, n_streams = _HEADER.unpack(unpacked.take(_HEADER.size))
        if magic != _MAGIC:
            raise FormatError(f"{path} is not an SPZ file. Choose another file.")
        if version not in ((4,) if is_plain else (2, 3)):
            raise FormatError(f"{path} is SPZ {version}; versions 2 to 4 are supported. Save it as one of these.")
        if not 0 < count <= _MAX_COUNT or degree > 3 or fraction_bits > 24:
            raise FormatError(
                f"{path} has {count} Gaussians with harmonics of degree {degree}; 1 to {_MAX_COUNT} of degree 0 to 3 "
                "are supported. Export it again."
            )
        n_rest = (degree + 1) ** 2 - 1
        # The Gaussians, and the bytes of one field.
        require_memory(path, count * (4 * (14 + 3 * n_rest) + 60 + 3 * n_rest))
        if isinstance(unpacked, _Streams):
            unpacked.begin(n_streams, 6 if degree else 5)
        gaussians = _unpack(unpacked, count, n_rest, version, fraction_bits)
        unpacked.require_end()
        gaussians = replace(gaussians, antialiased=bool(flags & _ANTIALIASED))
    return upright(gaussians, up or "y", path, advice)


def _unpack(unpacked: _Unpacked | _Streams, count: int, n_rest: int, version: int, fraction_bits: int) -> Gaussians:
    """Return the Gaussians in the axes of the file."""
    positions = np.zeros((count, 3, 4), np.uint8)
    positions[..., 1:] = unpacked.rows(count, 9).reshape(count, 3, 3)
    # The sign is in the highest of the three bytes.
    means = (positions.view("<i4")[..., 0] >> 8) / np.float32(2.0**fraction_bits)
    alphas = unpacked.rows(count, 1)[:, 0]
    sh = np.empty((count, 1 + n_rest, 3), np.float32)
    sh[:, 0] = (unpacked.rows(count, 3) / np.float32(255) - np.float32(0.5)) / np.float32(_COLOR_SCALE)
    log_scales = (unpacked.rows(count, 3) / np.float32(16) - np.float32(10)).astype(np.float32)
    quats = _rotations(unpacked.rows(count, 3 if version == 2 else 4))
    if n_rest:
        sh[:, 1:] = unpacked.rows(count, 3 * n_rest).reshape(count, n_rest, 3)
        sh[:, 1:] -= 128
        sh[:, 1:] /= 128
    return Gaussians(
        means=means.astype(np.float32),
        log_scales=log_scales,
        quats=quats,
        opacity_logits=logits_of(alphas / 255.0),
        sh=sh,
    )


def _rotations(rows: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return quaternions wxyz of unit length of rows of 3 (version 2) or 4 bytes."""
    count = len(rows)
    if rows.shape[1] == 3:
        xyz = rows / np.float32(127.5) - 1
        w = np.sqrt(np.maximum(0, 1 - (xyz * xyz).sum(axis=1, keepdims=True)))
        return np.concatenate([w, xyz], axis=1, dtype=np.float32)
    packed = np.ascontiguousarray(rows).view("<u4")[:, 0]
    largest = (packed >> np.uint32(30)).astype(int)
    xyzw, rest = np.zeros((count, 4), np.float32), packed
    for component in (3, 2, 1, 0):
        value = (rest & np.uint32(511)).astype(np.float32) / np.float32(511 * 2**0.5)
        value = np.where(rest >> np.uint32(9) & np.uint32(1), -value, value)
        xyzw[:, component] = np.where(largest == component, 0, value)
        rest = np.where(largest == component, rest, rest >> np.uint32(10))
    lost = np.sqrt(np.maximum(0, 1 - (xyzw * xyzw).sum(axis=1)))
    np.put_along_axis(xyzw, largest[:, None], lost[:, None], axis=1)
    return np.roll(xyzw, 1, axis=1)


class _Unpacked:
    """The content of a gzip stream, of which no more is unpacked than is asked for."""

    def __init__(self, stream: IO[bytes], path: Path, advice: str) -> None:
        self._chunks = self._unpack(stream)
        self._path, self._advice = path, advice
        self._rest = b""

    def _unpack(self, stream: IO[bytes]) -> Iterator[bytes]:
        unpacker = zlib.decompressobj(_GZIP)
        try:
            while not unpacker.eof:
                packed = unpacker.unconsumed_tail or stream.read(_CHUNK_BYTES)
                if not packed:
                    return
                yield unpacker.decompress(packed, _CHUNK_BYTES)
        except zlib.error as error:
            raise FormatError(f"{self._path} is a damaged SPZ file ({error}). {self._advice}") from error

    def take(self, n_bytes: int) -> bytearray:
        """Return the next bytes; raises `FormatError` when there are fewer."""
        content = bytearray(n_bytes)
        filled = 0
        while True:
            part = self._rest[: n_bytes - filled]
            content[filled : filled + len(part)] = part
            self._rest, filled = self._rest[len(part) :], filled + len(part)
            if filled == n_bytes:
                return content
            chunk = next(self._chunks, None)
            if chunk is None:
                raise FormatError(f"{self._path} is truncated: it ends before its last Gaussian. {self._advice}")
            self._rest = chunk

    def rows(self, count: int, width: int) -> NDArray[np.uint8]:
        """Return the next bytes as an array [count, width]."""
        return np.frombuffer(self.take(count * width), np.uint8).reshape(count, width)

    def require_end(self) -> None:
        """Raise `FormatError` when more follows."""
        if self._rest or any(self._chunks):
            raise FormatError(f"{self._path} is longer than its header states. {self._advice}")


class _Streams:
    """The content of an SPZ 4: its header, then its streams, each of which is a field."""

    def __init__(self, stream: IO[bytes], path: Path, advice: str) -> None:
        self._stream, self._path, self._advice = stream, path, advice
        self._size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        self._sizes: list[tuple[int, int]] = []

    def take(self, n_bytes: int) -> bytes:
        """Return the next bytes of the header; raises `FormatError` when there are fewer."""
        content = self._stream.read(n_bytes)
        if len(content) < n_bytes:
            raise self._truncated()
        return content

    def begin(self, stated: int, expected: int) -> None:
        """Read the rest of the header and the table of the `stated` streams, of which `expected` must be there."""
        (table,) = struct.unpack_from("<I", self.take(_HEADER_4_BYTES - _HEADER.size))
        if stated != expected or table < _HEADER_4_BYTES:
            raise self._damaged(f"it has {stated} streams instead of {expected}, whose table is at {table}")
        self._stream.seek(table)
        self._sizes = [_TABLE.unpack(self.take(_TABLE.size)) for _ in range(stated)]
        if self._stream.tell() + sum(packed for packed, _ in self._sizes) > self._size:
            raise self._truncated()

    def rows(self, count: int, width: int) -> NDArray[np.uint8]:
        """Return the next stream as an array [count, width]."""
        packed, unpacked = self._sizes.pop(0)
        if unpacked != count * width:
            raise self._damaged(f"a stream has {unpacked} bytes instead of {count * width}")
        try:
            content = unpack_zstandard(self.take(packed), unpacked, "or save it as SPZ 3, PLY or GLB")
        except ValueError as error:
            raise self._damaged(str(error)) from error
        return np.frombuffer(content, np.uint8).reshape(count, width)

    def require_end(self) -> None:
        """Raise `FormatError` when more follows."""
        if self._stream.tell() != self._size:
            raise FormatError(f"{self._path} is longer than its header states. {self._advice}")

    def _damaged(self, what: str) -> FormatError:
        return FormatError(f"{self._path} is a damaged SPZ file: {what}. {self._advice}")

    def _truncated(self) -> FormatError:
        return FormatError(f"{self._path} is truncated: it ends before its last Gaussian. {self._advice}")
