"""Reader of ``.splat``, the format of antimatter15's viewer: rows of 32 bytes without a header.

A row has the position and the linear scales as float32, red, green, blue and opacity in 8 bits, and the rotation wxyz
in 8 bits each, where 128 is 0. There are no harmonics. Values are in the axes of the PLY file that was converted.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..scene import Gaussians
from .axes import Up
from .bounds import fill, opened_with_size, require_memory, upright
from .spherical_harmonics import SH_C0
from .transform import logits_of

_ROW = np.dtype([("place", "<f4", 3), ("scales", "<f4", 3), ("color", "u1", 4), ("rotation", "u1", 4)])
_ADVICE = "Copy or export it again."


def read_splat(path: Path, *, up: Up | None = None) -> Gaussians:
    """Return the Gaussians of a ``.splat`` file, in the engine's world (Z up).

    Parameters
    ----------
    up : {"z", "-y", "y"}, optional
        Axis of the file that points up, which it does not say; by default -Y, as in the files of most programs.

    Raises
    ------
    FormatError
        When the file cannot be read, is not made of such rows, or has values that cannot be.
    """
    with opened_with_size(path) as (stream, size):
        count = size // _ROW.itemsize
        if size % _ROW.itemsize or not count:
            raise FormatError(
                f"{path} is not a SPLAT file, or is truncated: it has {size} bytes, and Gaussians have "
                f"{_ROW.itemsize} each. {_ADVICE}"
            )
        require_memory(path, count * (_ROW.itemsize + 14 * 4 + 40))
        rows = np.empty(count, _ROW)
        fill(rows, stream, path, _ADVICE)
    quats = rows["rotation"] / np.float32(255) * 2 - 1
    with np.errstate(invalid="ignore"):
        gaussians = Gaussians(
            means=rows["place"].copy(),
            log_scales=log_scales_of(rows["scales"], path),
            quats=quats.astype(np.float32),
            opacity_logits=logits_of(rows["color"][:, 3] / 255.0),
            sh=coefficients_of(rows["color"])[:, None],
        )
    return upright(gaussians, up or "-y", path, f"It may not be a SPLAT file. {_ADVICE}")


def log_scales_of(scales: NDArray[np.floating], path: Path) -> NDArray[np.float32]:
    """Return the logarithms of linear `scales` [N, 3]; raises `FormatError` for a negative one."""
    if (scales < 0).any():
        raise FormatError(f"{path} has Gaussians with negative sizes, so it is damaged or another kind of file.")
    logs: NDArray[np.float32] = np.log(np.maximum(scales.astype(np.float32), np.finfo(np.float32).tiny))
    return logs


def coefficients_of(colors: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the first coefficients [N, 3] of colours of 8 bits, the first three of `colors` [N, 4]."""
    coefficients: NDArray[np.float32] = ((colors[:, :3] / 255.0 - 0.5) / SH_C0).astype(np.float32)
    return coefficients
