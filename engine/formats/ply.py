"""Writer and tolerant reader of the standard 3D Gaussian splatting PLY (Kerbl et al. 2023).

A Gaussian has the float32 properties ``x y z nx ny nz f_dc_0..2 f_rest_0..(3 (n_sh - 1) - 1) opacity scale_0..2
rot_0..3``. ``opacity`` is a logit, ``scale`` a natural logarithm, ``rot`` a quaternion wxyz, and ``f_rest`` is
channel-major (all red coefficients, then green, then blue). The format defines neither unit nor axes. Viewers take -Y
for up; our files say which axis is up in the comment ``up_axis``.

Rows are read and written in chunks, so that the Gaussians are in memory once.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError, NumericalError
from ..core.files import atomic_write
from ..scene import Gaussians
from .axes import Up, file_from_z_up
from .bounds import fill, opened_with_size, require_memory, usable_rows
from .compressed_ply import read_compressed
from .origin import far_origin, moved_far
from .ply_header import Header, read_header, require_rows, skip_to
from .ply_rows import COLOR, NORMAL, POSITION, ROTATION, SCALE, RowsToWrite, columns_of, rest_names
from .render_mode import ANTIALIASED_NOTE, RENDER_MODE, RENDER_MODE_KEY, is_antialiased, without_mode
from .transform import AffineMap, logits_of

_ARRAYS = ("means", "log_scales", "quats", "opacity_logits", "sh")
_REST_COUNTS = (0, 9, 24, 45)
_ROWS_PER_CHUNK = 1 << 12
"""Gaussians read or written at once: their table stays in the processor's cache."""
_UNTURNED = 1e-6
"""Difference from the identity up to which a transform changes nothing; Blender's matrices are float32."""
_FLAT = float(np.log(1e-6))
"""Third log-scale of 2D Gaussians, which have two: that of SuperSplat and splat-transform."""
_UP_AXIS = "up_axis"
_GENERATOR = "generator Gaussian Heritage"


@dataclass(frozen=True)
class PlyFile:
    """A 3DGS PLY as it is stored.

    Attributes
    ----------
    gaussians : Gaussians
        In the axes of the file.
    extra : dict of str to array of shape [N]
        Properties that are not those of a Gaussian, in the type of the file; without normals that are all 0.
    header : tuple of str
        Lines of the header, for `write_ply`; empty for a compressed file.
    origin : array of shape [3], float64
        What was taken off the positions, in the axes of the file; 0 unless they are doubles far from 0, such as UTM.
    lost : array of shape [N, 3], float64, or None
        What float32 does not hold of the positions, for `write_ply`; None where it holds all.
    is_flat : bool
        Whether the file has two scales: 2D Gaussians (Huang et al. 2024), whose third scale is 1e-6 here.
    """

    gaussians: Gaussians
    extra: dict[str, NDArray[Any]]
    header: tuple[str, ...]
    origin: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    lost: NDArray[np.float64] | None = None
    is_flat: bool = False

    @property
    def antialiased(self) -> bool:
        """Whether the file says that its Gaussians were trained anti-aliased."""
        return self.gaussians.antialiased

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of how the file was read, in sentences."""
        notes = []
        if self.is_flat:
            notes.append("They are 2D Gaussians (2DGS), read as flat ones.")
        if self.antialiased:
            notes.append(ANTIALIASED_NOTE)
        if self.origin.any():
            place = ", ".join(f"{value:.0f}" for value in self.origin)
            notes.append(f"They are far from 0: ({place}) was taken off their coordinates, and comes back on export.")
        return tuple(notes)

    @property
    def up(self) -> Up | None:
        """The axis that the file says is up; None where it says nothing."""
        comments = [line.split()[1:] for line in self.header if line.startswith("comment ")]
        stated = next((words[1] for words in comments if words[:1] == [_UP_AXIS] and len(words) == 2), None)
        return cast(Up, stated) if stated in get_args(Up) else None

    @property
    def is_ours(self) -> bool:
        """Whether this program wrote the file. Before it stated the axis, Z was up in its files."""
        return f"comment {_GENERATOR}" in self.header


def write_ply(
    path: Path,
    gaussians: Gaussians,
    *,
    comments: Sequence[str] = (),
    up: Up | None = None,
    matrix: NDArray[np.float64] | None = None,
    extra: Mapping[str, NDArray[Any]] | None = None,
    header: Sequence[str] = (),
    lost: NDArray[np.floating] | None = None,
) -> None:
    """Write `gaussians` as a binary 3DGS PLY atomically, replacing an existing file.

    Parameters
    ----------
    gaussians : Gaussians
        Features are not part of the format and are not written.
    comments : sequence of str
        Header comments, e.g. ``"catalogue_number 1906.12"``; newlines become spaces. Readers such as plyfile refuse a
        header that is not ASCII, so other characters, and backslashes, are written as JSON escapes: ``\\u00d6lkanne``.
    up : {"z", "-y", "y"}, optional
        The axis of the file that points up, which a comment states; the Gaussians, in whose world Z is up, are turned.
        None: they are written as they are, and the file says nothing.
    matrix : array of shape [4, 4], float64, optional
        A transform of the Gaussians before they are turned.
    extra : mapping of str to array of shape [N], optional
        Further properties; without `header` they are written as float32.
    header : sequence of str
        Header of the file that the Gaussians came from (`PlyFile.header`). Its lines, with the properties in their
        order and types, are written again instead of the standard ones and of `comments`.
    lost : array of shape [N, 3], optional
        What is added to the means (`PlyFile.lost`).

    Notes
    -----
    Positions are written as doubles where `header` says so, and where the transform takes them so far from 0 that
    float32 would round them.

    Raises
    ------
    NumericalError
        When a value is not finite.
    DiskError
        When the file cannot be written.
    """
    extra = extra or {}
    turn = file_from_z_up(up) if matrix is None else file_from_z_up(up) @ matrix
    is_far = moved_far(gaussians, turn)
    rest = 3 * (gaussians.sh.shape[1] - 1)
    if header:
        lines = list(header)
        if is_far:
            lines = [f"property double {line.split()[-1]}" if _is_short_position(line) else line for line in lines]
        kept = Header.of(lines, path)
        dtype = next(element for element in kept.elements if element.name == "vertex").dtype
        lines = [f"element vertex {len(gaussians)}" if line.startswith("element vertex") else line for line in lines]
        if is_antialiased(header) != gaussians.antialiased:
            lines = without_mode(lines)
            place = 1 + next(number for number, line in enumerate(lines) if line.startswith("format"))
            lines.insert(place, f"comment {RENDER_MODE_KEY}: {RENDER_MODE[gaussians.antialiased]}")
    else:
        names = [*POSITION, *NORMAL, *COLOR, *rest_names(rest), "opacity", *SCALE, *ROTATION]
        names += [name for name in extra if name not in names]
        types = dict.fromkeys(names, ("<f4", "float")) | dict.fromkeys(POSITION if is_far else (), ("<f8", "double"))
        dtype = np.dtype([(name, types[name][0]) for name in names])
        stated = [*([] if up is None else [f"{_UP_AXIS} {up}"])]
        stated += [f"{RENDER_MODE_KEY}: {RENDER_MODE[True]}"] if gaussians.antialiased else []
        stated += comments
        lines = ["format binary_little_endian 1.0"]
        lines += [f"comment {ascii_text(' '.join(comment.split()))}" for comment in stated]
        lines += [f"element vertex {len(gaussians)}", *(f"property {types[name][1]} {name}" for name in names)]
    turned = None if np.allclose(turn, np.eye(4), rtol=0, atol=_UNTURNED) else AffineMap.of(turn, gaussians.sh_degree)
    is_shift = np.allclose(turn[:3, :3], np.eye(3), rtol=0, atol=_UNTURNED)
    is_wide = lost is not None or any(dtype[name] != np.dtype("<f4") for name in POSITION)
    # Values that are not finite are looked for after they were turned; sums that show them may overflow.
    with atomic_write(path) as stream, np.errstate(over="ignore", invalid="ignore"):
        stream.write("\n".join(["ply", *lines, "end_header", ""]).encode())
        rows = RowsToWrite(dtype, min(len(gaussians), _ROWS_PER_CHUNK), gaussians.sh.shape[1], tuple(extra))
        for start in range(0, len(gaussians), _ROWS_PER_CHUNK):
            chunk = slice(start, start + _ROWS_PER_CHUNK)
            part, places = gaussians[chunk], None
            if turned is not None:
                part = turned.shifted(part) if is_shift else turned(part)
            if is_wide:
                own = gaussians.means[chunk].astype(np.float64)
                own = own if lost is None else own + lost[chunk]
                if turned is not None:
                    own = own + turned.translation if is_shift else turned.places(own)
                places = own
            content = rows.put(part, {name: values[chunk] for name, values in extra.items()}, places)
            if not rows.are_finite(len(part)) and not _are_finite(part):
                check_finite(gaussians)
                check_finite(part)
            stream.write(content.data)


def _is_short_position(line: str) -> bool:
    words = line.split()
    return words[:1] == ["property"] and words[1:2] in (["float"], ["float32"]) and words[-1] in POSITION


def ascii_text(text: str) -> str:
    """Return `text` with JSON escapes for all but printable ASCII; quotes stay as they are."""
    return json.dumps(text)[1:-1].replace('\\"', '"')


def _are_finite(gaussians: Gaussians) -> bool:
    return all(np.isfinite(getattr(gaussians, name)).all() for name in _ARRAYS)


def check_finite(gaussians: Gaussians) -> None:
    """Raise `NumericalError` for the first array of `gaussians` with a value that is not finite."""
    for name in _ARRAYS:
        values = getattr(gaussians, name)
        # A sum is not finite where a value is not, and needs no second array; it may overflow where all are.
        with np.errstate(over="ignore", invalid="ignore"):
            if np.isfinite(values.sum(dtype=np.float64)):
                continue
        n_broken = values.size - int(np.count_nonzero(np.isfinite(values)))
        if n_broken:
            raise NumericalError(f"{n_broken} of {values.size} values of `{name}` are not finite. Nothing was written.")


def read_ply(path: Path, *, skip_broken: bool = False, advice: str = "Copy or export it again.") -> Gaussians:
    """Return the Gaussians of a 3DGS PLY in the engine's world: turned where the file says that another axis is up.

    Files that say nothing, as those of projects and of other programs, are returned as they are. See `read_ply_file`,
    which keeps double coordinates far from 0; here they are rounded to float32.
    """
    file = read_ply_file(path, skip_broken=skip_broken, advice=advice, with_extra=False)
    turn = file_from_z_up(file.up).T
    turn[:3, 3] = turn[:3, :3] @ file.origin
    if not np.array_equal(turn, np.eye(4)):
        AffineMap.of(turn, file.gaussians.sh_degree).apply(file.gaussians, into=file.gaussians)
    return file.gaussians


def read_ply_file(
    path: Path, *, skip_broken: bool = False, advice: str = "Copy or export it again.", with_extra: bool = True
) -> PlyFile:
    """Return the content of a 3DGS PLY, whose properties may be in any order.

    Parameters
    ----------
    path : Path
        Binary file of either byte order, with properties of any type, or compressed as by PlayCanvas.
    skip_broken : bool
        Whether to skip Gaussians with a value that is not finite or too large instead of refusing the file.
    advice : str
        What the user should do about an incomplete file.
    with_extra : bool
        Whether to read properties that are not those of a Gaussian.

    Raises
    ------
    FormatError
        When the file cannot be read, is not a PLY or has no Gaussians, is truncated or ASCII, or has values that are
        not finite or too large. Nothing is allocated for more Gaussians than the file has bytes for.
    """
    with opened_with_size(path) as (stream, size):
        header = read_header(stream, path, advice)
        if any(element.name == "chunk" for element in header.elements):
            gaussians = read_compressed(stream, header, path, size, advice)
            gaussians = replace(gaussians, antialiased=is_antialiased(header.lines))
            return PlyFile(_usable(gaussians, usable_rows(gaussians), path, skip_broken=skip_broken), {}, ())
        vertex = skip_to(stream, header, "vertex", path, size, advice)
        _check_properties(vertex.dtype, path)
        require_rows(stream, vertex, path, size, advice)
        if vertex.count == 0:
            raise FormatError(f"{path} has no Gaussians: its list is empty. Choose another file.")
        # The Gaussians, and a copy of them without broken ones.
        require_memory(path, 2 * vertex.count * vertex.dtype.itemsize)
        gaussians, extra, usable, places = _read_rows(
            stream, vertex.count, vertex.dtype, path, advice, with_extra=with_extra
        )
    is_whole = len(header.elements) == 1 and usable.all()
    extra = {name: values[usable] for name, values in extra.items()} if not usable.all() else extra
    gaussians = _usable(gaussians, usable, path, skip_broken=skip_broken)
    gaussians = replace(gaussians, antialiased=is_antialiased(header.lines))
    origin, lost = np.zeros(3), None
    if places is not None:
        gaussians, origin, lost = _near(gaussians, places[usable])
    comments = tuple(line for line in header.lines if line.startswith("comment "))
    is_flat = SCALE[2] not in (vertex.dtype.names or ())
    return PlyFile(gaussians, extra, header.lines if is_whole else comments, origin, lost, is_flat)


def _near(
    gaussians: Gaussians, places: NDArray[np.float64]
) -> tuple[Gaussians, NDArray[np.float64], NDArray[np.float64] | None]:
    """Return the Gaussians, at `places` [N, 3] less an origin; the origin; and what float32 does not hold of them."""
    origin = far_origin(places)
    offsets = places - origin
    means = offsets.astype(np.float32)
    lost: NDArray[np.float64] = offsets - means
    return replace(gaussians, means=means), origin, lost if lost.any() else None


def _read_rows(
    stream: IO[bytes], count: int, dtype: np.dtype[np.void], path: Path, advice: str, *, with_extra: bool
) -> tuple[Gaussians, dict[str, NDArray[Any]], NDArray[np.bool_], NDArray[np.float64] | None]:
    """Return the Gaussians, their further properties, which of them are usable, and positions of more than 32 bits."""
    names = dtype.names or ()
    rest = rest_names(sum(name.startswith("f_rest_") for name in names))
    known = {*POSITION, *COLOR, *rest, "opacity", *SCALE, *ROTATION}
    extra = {name: np.empty(count, dtype[name].newbyteorder("=")) for name in names if with_extra and name not in known}
    whole = Gaussians(
        means=np.empty((count, 3), np.float32),
        log_scales=np.empty((count, 3), np.float32),
        quats=np.empty((count, 4), np.float32),
        opacity_logits=np.empty(count, np.float32),
        sh=np.empty((count, 1 + len(rest) // 3, 3), np.float32),
    )
    scales = [name for name in SCALE if name in names]
    whole.log_scales[:, len(scales) :] = _FLAT
    is_wide = any(dtype[name].kind == "f" and dtype[name].itemsize > 4 or dtype[name].kind in "iu" for name in POSITION)
    places = np.empty((count, 3), np.float64) if is_wide else None
    usable = np.empty(count, bool)
    rows = np.empty(min(count, _ROWS_PER_CHUNK), dtype)
    for start in range(0, count, _ROWS_PER_CHUNK):
        part = slice(start, min(start + _ROWS_PER_CHUNK, count))
        chunk = rows[: part.stop - start]
        fill(chunk, stream, path, advice)
        columns = columns_of(chunk)
        whole.means[part] = columns(*POSITION)
        if places is not None:
            places[part] = np.stack([chunk[name] for name in POSITION], axis=1)
        whole.log_scales[part, : len(scales)] = columns(*scales)
        whole.quats[part] = columns(*ROTATION)
        whole.opacity_logits[part] = _finite_logits(columns("opacity")[:, 0])
        whole.sh[part, 0] = columns(*COLOR)
        if rest:
            channel_major = columns(*rest).reshape(len(chunk), 3, len(rest) // 3)
            whole.sh[part, 1:] = channel_major.transpose(0, 2, 1)
        for name, values in extra.items():
            values[part] = chunk[name]
        usable[part] = usable_rows(whole[part])
    if all(name in extra and not extra[name].any() for name in NORMAL):
        extra = {name: values for name, values in extra.items() if name not in NORMAL}
    return whole, extra, usable, places


def _check_properties(dtype: np.dtype[np.void], path: Path) -> None:
    names = set(dtype.names or ())
    # 2D Gaussians have two scales.
    missing = [name for name in (*POSITION, *COLOR, "opacity", *SCALE[:2], *ROTATION) if name not in names]
    if missing:
        kind = (
            "It looks like an ordinary point cloud or mesh"
            if names.issuperset(POSITION)
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


def _finite_logits(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return `logits` with the infinite values that some programs write for 0 and 1 replaced by finite ones."""
    transparent, opaque = logits_of(np.array([0.0, 1.0]))
    return np.nan_to_num(logits, nan=np.nan, posinf=opaque, neginf=transparent)


def _usable(gaussians: Gaussians, usable: NDArray[np.bool_], path: Path, *, skip_broken: bool) -> Gaussians:
    """Return the usable Gaussians; without `skip_broken` all must be."""
    n_broken = len(usable) - int(usable.sum())
    if n_broken and not skip_broken:
        raise FormatError(
            f"{path} has {n_broken} of {len(usable)} Gaussians with values that are not finite or too large. "
            "Repair the file, or import it with broken Gaussians skipped."
        )
    if n_broken == len(usable):
        raise FormatError(f"{path} has no Gaussian whose values are all finite. Choose another file.")
    return gaussians[usable] if n_broken else gaussians
