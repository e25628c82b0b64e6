"""Writer of SOG 2, the small format of PlayCanvas for the web; see `sog`, which reads it.

Gaussians are ordered along a Morton curve, in which neighbours are similar and pictures pack better.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..core.arrays import Pixels
from ..core.errors import FormatError
from ..core.files import atomic_write
from ..scene import Gaussians
from .codebooks import codebook, palette
from .facts import NO_FACTS, FileFacts
from .origin import require_near
from .ply import check_finite
from .sog import MAX_COUNT, META, PALETTE_WIDTH
from .transform import transform_gaussians

EncodePicture = Callable[[NDArray[np.uint8]], bytes]
"""Returns pixels [H, W, 4] as lossless WebP; the colours of pixels with an alpha of 0 may change."""


_LARGEST_PALETTE = 1 << 16
_MORTON_BITS = 21
_DATE = (1980, 1, 1, 0, 0, 0)
"""Of the parts of the zip file: the same Gaussians give the same file."""


def write_sog(path: Path, gaussians: Gaussians, encode: EncodePicture, facts: FileFacts = NO_FACTS) -> None:
    """Write `gaussians` as SOG 2, a zip file of pictures, atomically, replacing an existing file.

    Parameters
    ----------
    gaussians : Gaussians
        In the engine's world (Z up), at least one. Features are not written.
    encode : callable
        See `EncodePicture`: `engine.pictures.encode_picture` in the engine, and Blender's own.
    facts : FileFacts
        Of these, the axis, the transform and the record are written.

    Raises
    ------
    NumericalError
        When a value is not finite.
    FormatError
        When there are no Gaussians, too many, or they are moved too far away.
    DiskError
        When the file cannot be written.
    """
    check_finite(gaussians)
    if not 0 < len(gaussians) <= MAX_COUNT:
        raise FormatError(
            f"{path} would have {len(gaussians)} Gaussians; SOG holds 1 to {MAX_COUNT}. Export it as PLY or GLB."
        )
    require_near(gaussians, facts.matrix, path)
    turned = transform_gaussians(gaussians, facts.transform(facts.up))
    turned = turned[_morton_order(turned.means)]
    meta: dict[str, Any] = {
        "version": 2,
        "asset": {"generator": f"Gaussian Heritage {__version__}"},
        "count": len(turned),
        # The first is what splat-transform writes, the second what other programs read.
        **({"model": "antialiased", "antialias": True} if turned.antialiased else {}),
        **({"extras": dict(facts.extras)} if facts.extras else {}),
    }
    with atomic_write(path) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:

        def put(name: str, pixels: Pixels) -> str:
            archive.writestr(zipfile.ZipInfo(name, _DATE), encode(pixels))
            return name

        meta["means"] = _put_means(turned.means, put)
        meta["scales"] = _put_scales(turned.log_scales, put)
        meta["quats"] = {"files": [put("quats.webp", _grid(_packed_rotations(turned.quats)))]}
        meta["sh0"] = _put_colors(turned, put)
        if turned.sh_degree:
            meta["shN"] = _put_harmonics(turned.sh[:, 1:], turned.sh_degree, put)
        archive.writestr(zipfile.ZipInfo(META, _DATE), json.dumps(meta, ensure_ascii=False))


Put = Callable[[str, Pixels], str]


def _put_means(means: NDArray[np.float32], put: Put) -> dict[str, Any]:
    logs = np.sign(means) * np.log1p(np.abs(means.astype(np.float64)))
    low, high = logs.min(axis=0), logs.max(axis=0)
    steps = np.round((logs - low) / np.where(high > low, high - low, 1.0) * 65535).astype(np.uint16)
    files = [put("means_l.webp", _grid(_opaque(steps & 255))), put("means_u.webp", _grid(_opaque(steps >> 8)))]
    return {"mins": low.tolist(), "maxs": high.tolist(), "files": files}


def _put_scales(log_scales: NDArray[np.float32], put: Put) -> dict[str, Any]:
    book, numbers = codebook(log_scales)
    return {"codebook": _full(book), "files": [put("scales.webp", _grid(_opaque(numbers)))]}


def _put_colors(gaussians: Gaussians, put: Put) -> dict[str, Any]:
    book, numbers = codebook(gaussians.sh[:, 0])
    opacities = np.round(255 * gaussians.opacities.astype(np.float64))
    pixels = np.concatenate([numbers, opacities[:, None]], axis=1).astype(np.uint8)
    return {"codebook": _full(book), "files": [put("sh0.webp", _grid(pixels))]}


def _put_harmonics(rest: NDArray[np.float32], degree: int, put: Put) -> dict[str, Any]:
    """Write the coefficients [N, coefficients, 3] as a palette and a number in it for each Gaussian."""
    count, n_rest, _ = rest.shape
    entries, numbers = palette(rest.reshape(count, 3 * n_rest), _palette_size(count))
    rows = -(-len(entries) // PALETTE_WIDTH)
    book, steps = codebook(entries)
    pixels = np.zeros((rows * PALETTE_WIDTH * n_rest, 4), np.uint8)
    pixels[: len(entries) * n_rest] = _opaque(steps.reshape(-1, 3))
    pixels[:, 3] = 255
    labels = _opaque(np.stack([numbers & 255, numbers >> 8, np.zeros_like(numbers)], axis=1))
    files = [
        put("shN_centroids.webp", pixels.reshape(rows, PALETTE_WIDTH * n_rest, 4)),
        put("shN_labels.webp", _grid(labels)),
    ]
    return {"count": len(entries), "bands": degree, "codebook": _full(book), "files": files}


def _palette_size(count: int) -> int:
    """Return the entries of a palette for `count` Gaussians: the largest power of two that they fill, up to 65536."""
    return min(_LARGEST_PALETTE, 1 << (count.bit_length() - 1))


def _full(book: NDArray[np.float32]) -> list[float]:
    """Return a codebook of 256 numbers, as readers expect it, the last of which may be there several times."""
    return [*book.tolist(), *[float(book[-1])] * (256 - len(book))]


def _packed_rotations(quats: NDArray[np.float32]) -> Pixels:
    """Return three components of 8 bits, and 252 and the index of the largest, of wxyz."""
    wide = quats.astype(np.float64)
    lengths = np.linalg.norm(wide, axis=1, keepdims=True)
    wide = np.where(lengths > 0, wide / np.where(lengths > 0, lengths, 1), (1.0, 0.0, 0.0, 0.0))
    largest = np.abs(wide).argmax(axis=1)
    sign = np.where(np.take_along_axis(wide, largest[:, None], axis=1) < 0, -1, 1)
    others = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest]
    three = np.take_along_axis(wide * sign, others, axis=1) * math.sqrt(2)
    steps = np.round(255 * (three * 0.5 + 0.5)).clip(0, 255)
    return np.concatenate([steps, 252 + largest[:, None]], axis=1).astype(np.uint8)


def _opaque(values: NDArray[np.integer]) -> Pixels:
    """Return three channels [N, 3] with an alpha of 255."""
    alpha = np.full((len(values), 1), 255)
    return np.concatenate([values, alpha], axis=1).astype(np.uint8)


def _grid(pixels: Pixels) -> Pixels:
    """Return the pixels [N, 4] row by row as a picture [H, W, 4], whose sides are multiples of 4."""
    count = len(pixels)
    width = 4 * math.ceil(math.sqrt(count) / 4)
    height = -(-count // (4 * width)) * 4
    grid = np.zeros((height * width, 4), np.uint8)
    grid[:, 3] = 255
    grid[:count] = pixels
    return grid.reshape(height, width, 4)


def _morton_order(means: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return the order of the positions [N, 3] along a Morton curve through their box."""
    low, high = means.min(axis=0).astype(np.float64), means.max(axis=0).astype(np.float64)
    steps = (means - low) / np.where(high > low, high - low, 1.0) * ((1 << _MORTON_BITS) - 1)
    code = np.zeros(len(means), np.uint64)
    for axis in range(3):
        bits = steps[:, axis].astype(np.uint64)
        # The bits of a coordinate are moved apart, with two zeros between each of them.
        for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
                            (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):  # fmt: skip
            bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
        code |= bits << np.uint64(axis)
    return np.argsort(code, kind="stable")
