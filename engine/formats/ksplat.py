"""Reader of ``.ksplat``, the format of mkkellogg's GaussianSplats3D viewer, with its three levels of compression.

A header of 4096 bytes is followed by one of 1024 bytes for each section, then by the sections: the lengths of buckets
that are not full, the middles of all buckets, and the rows of the Gaussians. A row has the position, the linear scales,
the rotation wxyz, red, green, blue and opacity in 8 bits, and harmonics of degree 0 to 2, band by band and channel by
channel. Level 0 has float32; levels 1 and 2 have half precision, positions in 16 bits beside the middle of their
bucket, and level 2 harmonics in 8 bits. Values are in the axes of the file that was converted.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..scene import Gaussians
from .axes import Up
from .bounds import fill, opened_with_size, require_memory, upright
from .splat import coefficients_of, log_scales_of
from .transform import logits_of

_HEADER, _SECTION_HEADER = 4096, 1024
_MAX_SECTIONS = 10_000
_BUCKET_BYTES = 12
_REST = (0, 9, 24)
"""Coefficients of the bands above 0, of all channels, by degree."""
_SH_RANGE = 1.5
"""Largest coefficient of level 2 where the header says nothing."""
_STEPS = (1, 32767, 32767)
"""Steps from the middle of a bucket to its side, by level, where the section says nothing."""
_ADVICE = "Copy or export it again."


def read_ksplat(path: Path, *, up: Up | None = None) -> Gaussians:
    """Return the Gaussians of a ``.ksplat`` file, in the engine's world (Z up).

    Parameters
    ----------
    up : {"z", "-y", "y"}, optional
        Axis of the file that points up, which it does not say; by default -Y, as in the files of most programs.

    Raises
    ------
    FormatError
        When the file cannot be read, is not KSPLAT, has another version or is truncated, or has values that cannot be.
    """
    with opened_with_size(path) as (stream, size):
        head = stream.read(_HEADER)
        if len(head) < _HEADER or head[0] != 0 or head[1] == 0:
            raise FormatError(f"{path} is not a KSPLAT file of a version that is known (0.1). Choose another file.")
        n_sections, stated, level = struct.unpack_from("<I8xIH", head, 4)
        low, high = (value or default for value, default in zip(_sh_range(head), (-_SH_RANGE, _SH_RANGE), strict=True))
        if level > 2 or n_sections > _MAX_SECTIONS or n_sections * _SECTION_HEADER > size - _HEADER:
            raise _damaged(path, f"{n_sections} sections of the level {level} are not supported")
        sections = [_Section.of(stream.read(_SECTION_HEADER), level, path) for _ in range(n_sections)]
        count = sum(section.count for section in sections)
        if count == 0 or count != stated:
            raise _damaged(path, f"its sections have {count} of {stated} Gaussians")
        _require_bytes(sections, size, path)
        n_rest = max(section.n_rest for section in sections) // 3
        # The rows of one section, and the Gaussians with what they are made of.
        require_memory(path, size + count * 4 * (14 + 3 * n_rest) * 2)
        sh = np.zeros((count, 1 + n_rest, 3), np.float32)
        gaussians = Gaussians(
            np.empty((count, 3), np.float32),
            np.empty((count, 3), np.float32),
            np.empty((count, 4), np.float32),
            np.empty(count, np.float32),
            sh,
        )
        start = 0
        for section in sections:
            _read_section(stream, section, level, (low, high), gaussians[start : start + section.count], path)
            start += section.count
    return upright(gaussians, up or "-y", path, _ADVICE)


def _sh_range(head: bytes) -> tuple[float, float]:
    low, high = struct.unpack_from("<ff", head, 36)
    return low, high


def _damaged(path: Path, what: str) -> FormatError:
    return FormatError(f"{path} is a damaged KSPLAT file: {what}. {_ADVICE}")


@dataclass(frozen=True)
class _Section:
    """What the header of a section says; its rows are of the type `dtype`, with `n_rest` numbers of harmonics."""

    count: int
    most: int
    bucket_size: int
    n_buckets: int
    bucket_bytes: int
    n_full: int
    n_partial: int
    step: float
    n_steps: int
    n_rest: int
    dtype: np.dtype[np.void]

    @classmethod
    def of(cls, head: bytes, level: int, path: Path) -> _Section:
        """Return the section with the header `head`."""
        count, most, bucket_size, n_buckets, side, bucket_bytes, steps = struct.unpack_from("<IIIIfHxxI", head)
        n_full, n_partial, degree = struct.unpack_from("<IIH", head, 32)
        if degree >= len(_REST) or count > most:
            raise _damaged(path, f"a section has {count} of {most} Gaussians with harmonics of degree {degree}")
        if level and (bucket_bytes != _BUCKET_BYTES or n_full + n_partial > n_buckets):
            raise _damaged(path, f"a section has {n_full} full and {n_partial} other of {n_buckets} buckets")
        n_steps = steps or _STEPS[level]
        number, place, sh = (("<f4", "<f4", "<f4"), ("<f2", "<u2", "<f2"), ("<f2", "<u2", "u1"))[level]
        fields: list[Any] = [("place", place, 3), ("scales", number, 3), ("quats", number, 4), ("color", "u1", 4)]
        fields += [("rest", sh, _REST[degree])] if degree else []
        return cls(
            count,
            most,
            bucket_size,
            n_buckets if level else 0,
            bucket_bytes,
            n_full,
            n_partial,
            side / 2 / n_steps,
            n_steps,
            _REST[degree],
            np.dtype(fields),
        )

    @property
    def n_bytes(self) -> int:
        """Size of the section in the file."""
        return 4 * self.n_partial + self.bucket_bytes * self.n_buckets + self.most * self.dtype.itemsize


def _require_bytes(sections: list[_Section], size: int, path: Path) -> None:
    """Raise `FormatError` unless the file of `size` bytes has the rows of all `sections`."""
    begin = _HEADER + len(sections) * _SECTION_HEADER
    for section in sections:
        # Behind the last Gaussian of the last section, its unused rows may be missing.
        used = section.n_bytes - (section.most - section.count) * section.dtype.itemsize
        if begin + used > size:
            raise FormatError(f"{path} is truncated: it ends before its last Gaussian. {_ADVICE}")
        begin += section.n_bytes


def _read_section(
    stream: IO[bytes], section: _Section, level: int, sh_range: tuple[float, float], into: Gaussians, path: Path
) -> None:
    """Put the Gaussians of the section at which `stream` stands into `into`; it then stands at the next one."""
    end = stream.tell() + section.n_bytes
    lengths = _array(stream, section.n_partial, np.dtype("<u4"), path)
    middles = _array(stream, 3 * section.n_buckets, np.dtype("<f4"), path).reshape(-1, 3)
    rows = _array(stream, section.count, section.dtype, path)
    stream.seek(end)
    with np.errstate(invalid="ignore", over="ignore"):
        into.means[:] = rows["place"]
        if level and section.count:
            buckets = _buckets(section, lengths, path)
            into.means[:] = (rows["place"].astype(np.float64) - section.n_steps) * section.step + middles[buckets]
        into.log_scales[:] = log_scales_of(rows["scales"], path)
        into.quats[:] = rows["quats"]
        into.opacity_logits[:] = logits_of(rows["color"][:, 3] / 255.0)
        into.sh[:, 0] = coefficients_of(rows["color"])
        if section.n_rest:
            rest = rows["rest"].astype(np.float32)
            if level == 2:
                rest = (sh_range[0] + rest / 255 * (sh_range[1] - sh_range[0])).astype(np.float32)
            _put_harmonics(rest, into.sh)


def _array(stream: IO[bytes], count: int, dtype: np.dtype[Any], path: Path) -> NDArray[Any]:
    values = np.empty(count, dtype)
    fill(values, stream, path, _ADVICE)
    return values


def _buckets(section: _Section, lengths: NDArray[np.uint32], path: Path) -> NDArray[np.intp]:
    """Return the bucket of each row."""
    in_full = section.n_full * section.bucket_size
    ends = in_full + np.cumsum(lengths, dtype=np.int64)
    rows = np.arange(section.count)
    last = int(ends[-1]) if len(ends) else in_full
    if last < section.count or (in_full and not section.bucket_size):
        raise _damaged(path, f"its buckets hold {last} of {section.count} Gaussians")
    partial = section.n_full + np.searchsorted(ends, rows, side="right")
    found: NDArray[np.intp] = np.where(rows < in_full, rows // max(section.bucket_size, 1), partial)
    if int(found.max()) >= section.n_buckets:
        raise _damaged(path, f"a Gaussian is in the bucket {found.max()} of {section.n_buckets}")
    return found


def _put_harmonics(rest: NDArray[np.float32], sh: NDArray[np.float32]) -> None:
    """Put the coefficients `rest` [n, 9 or 24], by band, channel and order, into `sh` [n, coefficients, 3]."""
    start = 0
    for band in (1, 2) if rest.shape[1] > _REST[1] else (1,):
        width = 2 * band + 1
        values = rest[:, start : start + 3 * width].reshape(len(rest), 3, width)
        sh[:, band * band : (band + 1) * (band + 1)] = values.transpose(0, 2, 1)
        start += 3 * width
