"""What readers of Gaussians share: opening a file, checks of memory before it is read, and of the values after."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..core.files import opened
from ..core.system import free_memory
from ..scene import Gaussians
from .axes import Up, file_from_z_up
from .transform import AffineMap

_ALWAYS_FREE = 128 << 20
_ROWS_PER_CHUNK = 1 << 14
"""Gaussians checked at once."""
_MAX_VALUE = 1e18
"""Largest absolute value, whose square is finite in float32."""
_SURELY_WITHIN = 1e35
"""Sum of squares, rounded as float32, below which no value is beyond `_MAX_VALUE`."""
_MAX_LOG_SCALE = 41.0
"""Logarithm of about `_MAX_VALUE`."""


@contextlib.contextmanager
def opened_with_size(path: Path) -> Iterator[tuple[IO[bytes], int]]:
    """Open a file for reading, and return its stream at the beginning and its size in bytes.

    Raises
    ------
    FormatError
        When it cannot be opened or read.
    """
    with opened(path, advice="Check the path and its permissions.") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        yield stream, size


def require_memory(path: Path, n_bytes: int) -> None:
    """Raise `FormatError` when the file at `path` needs `n_bytes` of memory and fewer are free."""
    free = free_memory() if n_bytes > _ALWAYS_FREE else None
    if free is not None and n_bytes > free:
        raise FormatError(
            f"{path} takes {n_bytes / 1e9:.1f} GB of memory to read, and {free / 1e9:.1f} GB are free. Close other "
            "programs, or read it on a computer with more memory."
        )


def fill(values: NDArray[Any], stream: IO[bytes], path: Path, advice: str) -> None:
    """Read the contiguous `values` from a file that has as many bytes; raises `FormatError` where it has no longer."""
    if cast(Any, stream).readinto(values.view(np.uint8)) < values.nbytes:
        raise FormatError(f"{path} became shorter while it was read. {advice}")


def upright(gaussians: Gaussians, up: Up, path: Path, advice: str) -> Gaussians:
    """Return Gaussians of a file whose axis `up` points up, turned in place to the engine's world, Z up.

    Raises
    ------
    FormatError
        When a value is not finite or too large.
    """
    if not usable_rows(gaussians).all():
        raise FormatError(f"{path} has Gaussians with values that are not finite or too large. {advice}")
    AffineMap.of(file_from_z_up(up).T, gaussians.sh_degree).apply(gaussians, into=gaussians)
    return gaussians


def usable_rows(gaussians: Gaussians) -> NDArray[np.bool_]:
    """Return for each Gaussian whether all its values are finite, and small enough to compute with."""
    usable = np.ones(len(gaussians), dtype=bool)
    for start in range(0, len(gaussians), _ROWS_PER_CHUNK):
        rows = slice(start, start + _ROWS_PER_CHUNK)
        part = gaussians[rows]
        for values in (part.means, part.log_scales, part.quats, part.opacity_logits, part.sh):
            flat = values.reshape(-1)
            # NaN compares as False. The sum needs no second array.
            if np.einsum("i,i->", flat, flat) < _SURELY_WITHIN:
                continue
            within = np.abs(values) <= _MAX_VALUE
            if not within.all():
                usable[rows] &= within.reshape(len(values), -1).all(axis=1)
        usable[rows] &= (part.log_scales <= _MAX_LOG_SCALE).all(axis=1)
    return usable
