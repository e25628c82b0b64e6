"""Writer and tolerant reader of the standard 3D Gaussian splatting PLY (Kerbl et al. 2023).

A Gaussian has the float32 properties ``x y z nx ny nz f_dc_0..2 f_rest_0..(3 (n_sh - 1) - 1) opacity scale_0..2
rot_0..3``. ``opacity`` is a logit, ``scale`` a natural logarithm, ``rot`` a quaternion wxyz, and ``f_rest`` is
channel-major (all red coefficients, then green, then blue). The format defines neither unit nor axes: both are those of
the given Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ..errors import DiskError, FormatError, NumericalError
from ..files import atomic_write
from ..scene import Gaussians
from .transform import logits_of

__all__ = ["check_finite", "read_ply", "write_ply"]

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_POSITION = ("x", "y", "z")
_COLOR = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE = ("scale_0", "scale_1", "scale_2")
_ROTATION = ("rot_0", "rot_1", "rot_2", "rot_3")
_REST_COUNTS = (0, 9, 24, 45)
_ROWS_PER_CHUNK = 1 << 16
"""Gaussians written at once, to limit the memory of their table."""
_MAX_HEADER = 1 << 20
"""Bytes. A longer header is taken for damage."""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    dtype: np.dtype[np.void] | None
    """Row type; None when the element has a list property, so that its rows have no fixed size."""


def write_ply(path: Path, gaussians: Gaussians, *, comments: Sequence[str] = ()) -> None:
    """Write `gaussians` as a binary little-endian 3DGS PLY atomically, replacing an existing file.

    Parameters
    ----------
    path : Path
    gaussians : Gaussians
        Features are not part of the format and are not written.
    comments : sequence of str
        Header comments, e.g. ``"catalogue_number 1906.12"``; newlines become spaces.

    Raises
    ------
    NumericalError
        When a value is not finite.
    DiskError
        When the file cannot be written.
    """
    check_finite(gaussians)
    rest = 3 * (gaussians.sh.shape[1] - 1)
    names = [
        *_POSITION,
        "nx",
        "ny",
        "nz",
        *_COLOR,
        *(f"f_rest_{i}" for i in range(rest)),
        "opacity",
        *_SCALE,
        *_ROTATION,
    ]
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"comment {' '.join(comment.split())}" for comment in comments]
    lines += [
        f"element vertex {len(gaussians)}",
        *(f"property float {name}" for name in names),
        "end_header",
        "",
    ]
    with atomic_write(path) as stream:
        stream.write("\n".join(lines).encode())
        for start in range(0, len(gaussians), _ROWS_PER_CHUNK):
            part = gaussians[slice(start, start + _ROWS_PER_CHUNK)]
            rows = np.zeros((len(part), len(names)), dtype="<f4")
            rows[:, 0:3] = part.means
            rows[:, 6:9] = part.sh[:, 0]
            rows[:, 9 : 9 + rest] = part.sh[:, 1:].transpose(0, 2, 1).reshape(len(part), rest)
            rows[:, 9 + rest] = part.opacity_logits
            rows[:, 10 + rest : 13 + rest] = part.log_scales
            rows[:, 13 + rest :] = part.quats
            stream.write(rows.data)


def check_finite(gaussians: Gaussians) -> None:
    """Raise `NumericalError` for the first array of `gaussians` with a value that is not finite."""
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        values = getattr(gaussians, name)
        n_broken = values.size - int(np.count_nonzero(np.isfinite(values)))
        if n_broken:
            raise NumericalError(f"{n_broken} of {values.size} values of `{name}` are not finite. Nothing was written.")


def read_ply(path: Path, *, skip_broken: bool = False) -> Gaussians:
    """Return the Gaussians of a 3DGS PLY, whose properties may be in any order; unknown properties are ignored.

    Parameters
    ----------
    path : Path
        Binary file of either byte order.
    skip_broken : bool
        Whether to skip Gaussians with a value that is not finite instead of refusing the file.

    Raises
    ------
    FormatError
        When the file is not a PLY or has no Gaussians, is truncated, ASCII or compressed, or has values that are not
        finite.
    DiskError
        When the file cannot be read.
    """
    try:
        with path.open("rb") as stream:
            elements = _read_header(stream, path)
            vertex = _skip_to_vertex(stream, elements, path)
            _check_properties(vertex, path)
            assert vertex.dtype is not None
            rows = np.fromfile(stream, dtype=vertex.dtype, count=vertex.count)
    except OSError as error:
        raise DiskError(
            f"Could not read {path}: {error.strerror or error}. Check the path and its permissions."
        ) from error
    if len(rows) < vertex.count:
        raise FormatError(
            f"{path} is truncated: its header states {vertex.count} Gaussians and it has {len(rows)}. "
            "Copy or export it again."
        )
    return _drop_or_refuse_broken(_gaussians_from_rows(rows), path, skip_broken=skip_broken)


def _read_header(stream: IO[bytes], path: Path) -> list[_Element]:
    if stream.readline(64).strip() != b"ply":
        raise FormatError(f"{path} is not a PLY file. Choose a Gaussian scene saved as .ply.")
    lines: list[str] = []
    while True:
        raw = stream.readline(_MAX_HEADER)
        if not raw or stream.tell() > _MAX_HEADER:
            raise FormatError(f"{path} is not a readable PLY file: its header does not end. Copy or export it again.")
        line = raw.decode("utf-8", "replace").strip()
        if line == "end_header":
            break
        lines.append(line)
    order = _byte_order(lines, path)
    elements: list[_Element] = []
    properties: list[tuple[str, str]] = []
    for line in [*lines, "element end 0"]:
        words = line.split()
        try:
            if words[:1] == ["element"]:
                if elements:
                    elements[-1] = _with_properties(elements[-1], properties)
                elements.append(_Element(words[1], int(words[2]), np.dtype([])))
                properties = []
            elif words[:2] == ["property", "list"]:
                elements[-1] = _Element(elements[-1].name, elements[-1].count, None)
            elif words[:1] == ["property"]:
                properties.append((words[2], order + _TYPES[words[1]]))
        except (IndexError, KeyError, ValueError) as error:
            raise FormatError(
                f"{path} has a PLY header line that cannot be read: `{line}`. Export it again."
            ) from error
    return elements[:-1]


def _with_properties(element: _Element, properties: list[tuple[str, str]]) -> _Element:
    """Return `element` with its row type; NumPy raises `ValueError` for a repeated property name."""
    return element if element.dtype is None else _Element(element.name, element.count, np.dtype(properties))


def _byte_order(lines: list[str], path: Path) -> str:
    for line in lines:
        if line.startswith("format"):
            if "binary_little_endian" in line:
                return "<"
            if "binary_big_endian" in line:
                return ">"
            raise FormatError(
                f"{path} is an ASCII PLY file, as point clouds and meshes often are; Gaussian scenes are binary. "
                "Choose a 3DGS PLY, or save it as binary PLY if it is one."
            )
    raise FormatError(f"{path} is not a readable PLY file: it states no format. Export it again.")


def _skip_to_vertex(stream: IO[bytes], elements: list[_Element], path: Path) -> _Element:
    if any(element.name == "chunk" for element in elements):
        raise FormatError(
            f"{path} is a compressed Gaussian PLY. Save it uncompressed (standard 3DGS PLY) and import that."
        )
    for element in elements:
        if element.name == "vertex" and element.dtype is not None:
            return element
        if element.dtype is None:
            break
        stream.seek(element.count * element.dtype.itemsize, 1)
    raise FormatError(f"{path} contains no Gaussians: it has no plain `vertex` element. Choose a standard 3DGS PLY.")


def _check_properties(vertex: _Element, path: Path) -> None:
    assert vertex.dtype is not None
    names = set(vertex.dtype.names or ())
    missing = [name for name in (*_POSITION, *_COLOR, "opacity", *_SCALE, *_ROTATION) if name not in names]
    if missing:
        kind = (
            "It looks like an ordinary point cloud or mesh"
            if names.issuperset(_POSITION)
            else "It has no positions either"
        )
        raise FormatError(
            f"{path} is not a Gaussian PLY: it has no {', '.join(missing)}. {kind}; "
            "choose the file that a Gaussian splatting program saved."
        )
    rest = sum(name.startswith("f_rest_") for name in names)
    if rest not in _REST_COUNTS or any(f"f_rest_{i}" not in names for i in range(rest)):
        raise FormatError(
            f"{path} has {rest} `f_rest` properties; spherical harmonics of degree 0 to 3 have 0, 9, "
            "24 or 45. Export it again with degree 3 or lower."
        )


def _gaussians_from_rows(rows: NDArray[np.void]) -> Gaussians:
    names = list(rows.dtype.names or ())
    table = None
    if all(rows.dtype[name] == np.dtype("<f4") for name in names):
        table = rows.view("<f4").reshape(len(rows), len(names))

    def columns(*wanted: str) -> NDArray[np.float32]:
        if table is not None:
            indices = [names.index(name) for name in wanted]
            first, last = indices[0], indices[-1] + 1
            contiguous = indices == list(range(first, last))
            return np.ascontiguousarray(table[:, first:last] if contiguous else table[:, indices], dtype=np.float32)
        return np.stack([rows[name].astype(np.float32) for name in wanted], axis=1)

    rest = sum(name.startswith("f_rest_") for name in names)
    sh = np.empty((len(rows), 1 + rest // 3, 3), dtype=np.float32)
    sh[:, 0] = columns(*_COLOR)
    if rest:
        channel_major = columns(*(f"f_rest_{i}" for i in range(rest)))
        sh[:, 1:] = channel_major.reshape(len(rows), 3, rest // 3).transpose(0, 2, 1)
    return Gaussians(
        means=columns(*_POSITION),
        log_scales=columns(*_SCALE),
        quats=columns(*_ROTATION),
        opacity_logits=_finite_logits(columns("opacity")[:, 0]),
        sh=sh,
    )


def _finite_logits(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return `logits` with the infinite values that some programs write for 0 and 1 replaced by finite ones."""
    transparent, opaque = logits_of(np.array([0.0, 1.0]))
    return np.nan_to_num(logits, nan=np.nan, posinf=opaque, neginf=transparent)


def _drop_or_refuse_broken(gaussians: Gaussians, path: Path, *, skip_broken: bool) -> Gaussians:
    count = len(gaussians)
    finite = np.ones(count, dtype=bool)
    for values in (
        gaussians.means,
        gaussians.log_scales,
        gaussians.quats,
        gaussians.opacity_logits,
        gaussians.sh,
    ):
        if not np.isfinite(values).all():
            finite &= np.isfinite(values).reshape(count, -1).all(axis=1)
    broken = count - int(finite.sum())
    if broken and not skip_broken:
        raise FormatError(
            f"{path} has {broken} of {count} Gaussians with values that are not finite. "
            "Repair the file, or import it with broken Gaussians skipped."
        )
    return gaussians[finite] if broken else gaussians
