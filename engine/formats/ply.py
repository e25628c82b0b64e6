"""Writer and tolerant reader of the standard 3D Gaussian splatting PLY (Kerbl et al. 2023).

A Gaussian has the float32 properties ``x y z nx ny nz f_dc_0..2 f_rest_0..(3 (n_sh - 1) - 1) opacity scale_0..2
rot_0..3``. ``opacity`` is a logit, ``scale`` a natural logarithm, ``rot`` a quaternion wxyz, and ``f_rest`` is
channel-major (all red coefficients, then green, then blue). The format defines neither unit nor axes: both are those of
the given Gaussians.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, NumericalError
from ..files import atomic_write, opened
from ..scene import Gaussians
from .bounds import require_memory, usable_rows
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
_MAX_HEADER_LINES = 10_000
_MAX_PROPERTIES = 1000
_CHUNK_BYTES = 1 << 24


@dataclass
class _Element:
    name: str
    count: int
    properties: dict[str, str] = field(default_factory=dict)
    """NumPy type of each property that is no list."""
    n_properties: int = 0
    has_lists: bool = False

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Type of a row."""
        return np.dtype(list(self.properties.items()))


def write_ply(path: Path, gaussians: Gaussians, *, comments: Sequence[str] = ()) -> None:
    """Write `gaussians` as a binary little-endian 3DGS PLY atomically, replacing an existing file.

    Parameters
    ----------
    path : Path
    gaussians : Gaussians
        Features are not part of the format and are not written.
    comments : sequence of str
        Header comments, e.g. ``"catalogue_number 1906.12"``; newlines become spaces. Readers such as plyfile refuse a
        header that is not ASCII, so other characters, and backslashes, are written as JSON escapes: ``\\u00d6lkanne``.

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
    lines += [f"comment {_ascii(' '.join(comment.split()))}" for comment in comments]
    lines += [
        f"element vertex {len(gaussians)}",
        *(f"property float {name}" for name in names),
        "end_header",
        "",
    ]
    with atomic_write(path) as stream:
        stream.write("\n".join(lines).encode("ascii"))
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


def _ascii(text: str) -> str:
    """Return `text` with JSON escapes for all but printable ASCII; quotes stay as they are."""
    return json.dumps(text)[1:-1].replace('\\"', '"')


def check_finite(gaussians: Gaussians) -> None:
    """Raise `NumericalError` for the first array of `gaussians` with a value that is not finite."""
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        values = getattr(gaussians, name)
        n_broken = values.size - int(np.count_nonzero(np.isfinite(values)))
        if n_broken:
            raise NumericalError(f"{n_broken} of {values.size} values of `{name}` are not finite. Nothing was written.")


def read_ply(path: Path, *, skip_broken: bool = False, advice: str = "Copy or export it again.") -> Gaussians:
    """Return the Gaussians of a 3DGS PLY, whose properties may be in any order; unknown properties are ignored.

    Parameters
    ----------
    path : Path
        Binary file of either byte order.
    skip_broken : bool
        Whether to skip Gaussians with a value that is not finite or too large instead of refusing the file.
    advice : str
        What the user should do about an incomplete file.

    Raises
    ------
    FormatError
        When the file cannot be read, is not a PLY or has no Gaussians, is truncated, ASCII or compressed, or has values
        that are not finite or too large. Nothing is allocated for more Gaussians than the file has bytes for.
    """
    with opened(path, advice="Check the path and its permissions.") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        elements = _read_header(stream, path, advice)
        vertex = _skip_to_vertex(stream, elements, path, size, advice)
        dtype = vertex.dtype
        _check_properties(dtype, path)
        complete = (size - stream.tell()) // dtype.itemsize
        if complete < vertex.count:
            raise FormatError(
                f"{path} is truncated: its header states {vertex.count} Gaussians and it has {complete}. {advice}"
            )
        if vertex.count == 0:
            raise FormatError(f"{path} has no Gaussians: its list is empty. Choose another file.")
        rows = _read_rows(stream, vertex.count, dtype, path, advice)
    return _drop_or_refuse_broken(_gaussians_from_rows(rows), path, skip_broken=skip_broken)


def _read_rows(stream: IO[bytes], count: int, dtype: np.dtype[np.void], path: Path, advice: str) -> NDArray[np.void]:
    # The table, and the arrays that are made of it.
    require_memory(path, 2 * count * dtype.itemsize)
    rows = np.empty(count, dtype)
    data = rows.view(np.uint8)
    for start in range(0, len(data), _CHUNK_BYTES):
        chunk = stream.read(min(_CHUNK_BYTES, len(data) - start))
        if len(chunk) < min(_CHUNK_BYTES, len(data) - start):
            raise FormatError(f"{path} became shorter while it was read. {advice}")
        data[start : start + len(chunk)] = np.frombuffer(chunk, np.uint8)
    return rows


def _read_header(stream: IO[bytes], path: Path, advice: str) -> list[_Element]:
    if stream.readline(64).strip() != b"ply":
        raise FormatError(f"{path} is not a PLY file. Choose a Gaussian scene saved as .ply.")
    lines: list[str] = []
    while True:
        raw = stream.readline(_MAX_HEADER)
        if not raw or stream.tell() > _MAX_HEADER or len(lines) > _MAX_HEADER_LINES:
            raise FormatError(f"{path} is not a readable PLY file: its header does not end. {advice}")
        line = raw.decode("utf-8", "replace").strip()
        if line == "end_header":
            break
        lines.append(line)
    order = _byte_order(lines, path)
    elements: list[_Element] = []
    for line in lines:
        words = line.split()
        try:
            if words[:1] == ["element"]:
                elements.append(_Element(words[1], _count(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].has_lists = True
            elif words[:1] == ["property"]:
                elements[-1].properties[words[2]] = order + _TYPES[words[1]]
                elements[-1].n_properties += 1
        except (IndexError, KeyError, ValueError) as error:
            raise FormatError(
                f"{path} has a PLY header line that cannot be read: `{line[:80]}`. Export it again."
            ) from error
    names = [element.name for element in elements]
    if len(set(names)) < len(names) or any(len(one.properties) < one.n_properties for one in elements):
        raise FormatError(f"{path} has a PLY header that lists an element or a property twice. Export it again.")
    if any(one.n_properties > _MAX_PROPERTIES for one in elements):
        raise FormatError(f"{path} has more than {_MAX_PROPERTIES} properties in one element. Export it again.")
    return elements


def _count(word: str) -> int:
    """Return a count of elements; raises `ValueError` for text, a negative number, or one that no file can have."""
    if not (word.isascii() and word.isdecimal() and len(word) <= 15):
        raise ValueError(word)
    return int(word)


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


def _skip_to_vertex(stream: IO[bytes], elements: list[_Element], path: Path, size: int, advice: str) -> _Element:
    """Return the element of the Gaussians; the stream, of `size` bytes, then stands at its rows."""
    if any(element.name == "chunk" for element in elements):
        raise FormatError(
            f"{path} is a compressed Gaussian PLY. Save it uncompressed (standard 3DGS PLY) and import that."
        )
    names = [element.name for element in elements]
    before = elements[: names.index("vertex")] if "vertex" in names else []
    vertex = elements[len(before)] if "vertex" in names else None
    # The rows of a list have no fixed size.
    if vertex is None or any(element.has_lists for element in (*before, vertex)):
        raise FormatError(
            f"{path} contains no Gaussians: it has no plain `vertex` element. Choose a standard 3DGS PLY."
        )
    for element in before:
        n_bytes = element.count * element.dtype.itemsize
        if n_bytes > size - stream.tell():
            raise FormatError(
                f"{path} is truncated: its header states {element.count} rows of `{element.name[:40]}`. {advice}"
            )
        stream.seek(n_bytes, os.SEEK_CUR)
    return vertex


def _check_properties(dtype: np.dtype[np.void], path: Path) -> None:
    names = set(dtype.names or ())
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
        # What float32 cannot hold becomes infinite, and is refused or skipped as such.
        with np.errstate(over="ignore"):
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
    usable = usable_rows(gaussians)
    n_broken = len(usable) - int(usable.sum())
    if n_broken and not skip_broken:
        raise FormatError(
            f"{path} has {n_broken} of {len(usable)} Gaussians with values that are not finite or too large. "
            "Repair the file, or import it with broken Gaussians skipped."
        )
    if n_broken == len(usable):
        raise FormatError(f"{path} has no Gaussian whose values are all finite. Choose another file.")
    return gaussians[usable] if n_broken else gaussians
