"""Reader of the compressed PLY of PlayCanvas: 256 Gaussians share the ranges in which their values are rounded.

A vertex has four 32 bit numbers: position (11, 10, 11 bits) and log-scale (11, 10, 11), each in the range of its
chunk; rotation, as the index of its largest component in 2 bits and the three others in 10 bits each; and colour and
opacity in 8 bits each. The element ``sh`` has 8 bits for each further coefficient of the spherical harmonics.
"""

from __future__ import annotations

from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32
from ..core.errors import FormatError
from ..scene import Gaussians
from .bounds import fill, require_memory
from .ply_header import Element, Header, require_rows, skip_to
from .spherical_harmonics import SH_C0
from .transform import logits_of

_CHUNK = 256
"""Gaussians of a chunk."""
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_SH_RANGE = 8.0
"""Width of the range of the coefficients of the element ``sh``, which is centred at 0."""


def read_compressed(stream: IO[bytes], header: Header, path: Path, size: int, advice: str) -> Gaussians:
    """Return the Gaussians of a compressed PLY of `size` bytes, whose `stream` stands at the first row.

    Raises
    ------
    FormatError
        When an element or a property is missing, or rows are.
    """
    begin = stream.tell()

    def rows(name: str) -> NDArray[np.void]:
        stream.seek(begin)
        element = skip_to(stream, header, name, path, size, advice)
        _check(element, path)
        require_rows(stream, element, path, size, advice)
        values = np.empty(element.count, element.dtype)
        fill(values, stream, path, advice)
        return values

    count = next((element.count for element in header.elements if element.name == "vertex"), 0)
    # Rows cannot be allocated for more Gaussians than the file has bytes for.
    require_memory(path, min(count, size) * 2 * 240)
    chunks, vertices = rows("chunk"), rows("vertex")
    if len(vertices) == 0:
        raise FormatError(f"{path} has no Gaussians: its list is empty. Choose another file.")
    if len(chunks) * _CHUNK < len(vertices):
        raise FormatError(f"{path} has {len(chunks)} chunks for {len(vertices)} Gaussians, which are too few. {advice}")
    of = np.arange(len(vertices)) // _CHUNK

    def in_range(values: Float32, prefix: str, axes: str) -> Float32:
        if f"min_{prefix}{axes[0]}" not in (chunks.dtype.names or ()):
            return values  # Older files have no ranges of colours.
        low, high = (np.stack([chunks[f"{end}_{prefix}{axis}"] for axis in axes], axis=1)[of] for end in ("min", "max"))
        return (low * (1 - values) + high * values).astype(np.float32)

    color = _bits(vertices["packed_color"], (8, 8, 8, 8))
    sh0 = (in_range(color[:, :3], "", "rgb") - 0.5) / SH_C0
    sh = [sh0[:, None]]
    if any(element.name == "sh" for element in header.elements):
        table = rows("sh")
        if len(table) != len(vertices):
            raise FormatError(f"{path} has harmonics for {len(table)} of {len(vertices)} Gaussians. {advice}")
        sh.append(_harmonics(table))
    with np.errstate(invalid="ignore", over="ignore"):
        return Gaussians(
            means=in_range(_bits(vertices["packed_position"], (11, 10, 11)), "", "xyz").astype(np.float32),
            log_scales=in_range(_bits(vertices["packed_scale"], (11, 10, 11)), "scale_", "xyz").astype(np.float32),
            quats=_rotations(vertices["packed_rotation"]),
            opacity_logits=logits_of(color[:, 3]),
            sh=np.concatenate(sh, axis=1, dtype=np.float32),
        )


def _check(element: Element, path: Path) -> None:
    names, kinds = tuple(element.properties), {kind[1:] for kind in element.properties.values()}
    ranges = [f"{end}_{what}{axis}" for end in ("min", "max") for what in ("", "scale_") for axis in "xyz"]
    good = {
        "chunk": set(names).issuperset(ranges) and kinds == {"f4"},
        "vertex": set(names).issuperset(_PACKED) and kinds == {"u4"},
        "sh": len(names) in (9, 24, 45)
        and kinds == {"u1"}
        and names == tuple(f"f_rest_{i}" for i in range(len(names))),
    }[element.name]
    if not good:
        raise FormatError(
            f"{path} is a compressed Gaussian PLY with other properties of `{element.name}` than PlayCanvas writes. "
            "Save it uncompressed and import that."
        )


def _bits(packed: NDArray[Any], widths: tuple[int, ...]) -> Float32:
    """Return the numbers, [n, parts] in [0, 1], that are packed from the highest bit on."""
    shift, parts = 32, []
    for width in widths:
        shift -= width
        parts.append(
            ((packed >> np.uint32(shift)) & np.uint32((1 << width) - 1)).astype(np.float32) / ((1 << width) - 1)
        )
    return np.stack(parts, axis=1)


def _rotations(packed: NDArray[Any]) -> Float32:
    """Return quaternions wxyz of unit length, [n, 4]."""
    three = (_bits(packed << np.uint32(2), (10, 10, 10)) - 0.5) * np.float32(2**0.5)
    largest = (packed >> np.uint32(30)).astype(int)
    quats = np.empty((len(packed), 4), np.float32)
    others = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest]
    np.put_along_axis(quats, others, three, axis=1)
    rest = np.sqrt(np.maximum(0, 1 - (three * three).sum(axis=1)))
    np.put_along_axis(quats, largest[:, None], rest[:, None], axis=1)
    return quats


def _harmonics(rows: NDArray[np.void]) -> Float32:
    """Return the coefficients of the bands above 0, [n, coefficients, 3]."""
    names = rows.dtype.names or ()
    table = rows.view(np.uint8).reshape(len(rows), 3, len(names) // 3).transpose(0, 2, 1)
    # The end values stand for the ends of the range, the others for the middles of their steps.
    levels = np.append(np.append(0.0, (np.arange(1, 255) + 0.5) / 256), 1.0)
    return ((levels - 0.5) * _SH_RANGE).astype(np.float32)[table]
