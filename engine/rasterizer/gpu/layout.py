"""Sizes of an image and of its buffers, and the layout of spherical harmonics in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float32
from ...core.errors import NumericalError

BLOCK = 64
"""Gaussians in a block of `pack_sh`."""


@dataclass(frozen=True)
class FrameSize:
    """Sizes that the buffers of a frame depend on.

    Attributes
    ----------
    n, n_sh, n_channels : int
        Gaussians, coefficients of spherical harmonics (0 for none), channels beside the colours.
    width, height : int
        Pixels.
    capacity : int
        Pairs of a tile and a Gaussian.
    backward : bool
        Whether the backward pass has buffers too.
    room : int
        Gaussians that the buffers hold, if that is more than `n`.
    """

    n: int
    n_sh: int
    n_channels: int
    width: int
    height: int
    capacity: int
    backward: bool = True
    room: int = 0

    @property
    def n_room(self) -> int:
        """Gaussians that the buffers hold, at least 1."""
        return max(self.n, self.room, 1)

    @property
    def n_rgb(self) -> int:
        """3 with spherical harmonics, else 0."""
        return 3 if self.n_sh else 0

    @property
    def n_out(self) -> int:
        """Number of channels of the image."""
        return self.n_rgb + self.n_channels

    @property
    def n_tiles(self) -> int:
        """Number of tiles of 16x16 pixels."""
        return -(-self.width // 16) * -(-self.height // 16)


def grown_capacity(n_wanted: int, n: int) -> int:
    """Return the capacity of the buffers for `n_wanted` pairs of a tile and one of `n` Gaussians, with headroom.

    Raises
    ------
    NumericalError
        If these are 2^31 pairs or more.
    """
    if n_wanted >= 2**31:
        raise NumericalError(
            f"`scales` are so large that {n} Gaussians cover {n_wanted} tiles of an image; resume from the last "
            "checkpoint with a lower learning rate for the scales."
        )
    return n_wanted + n_wanted // 8


def with_room(n: int, held: int) -> int:
    """Return the size of a buffer for `n` values or bytes: that which is `held` if it is enough, otherwise with headroom."""
    return held if n <= held else -(-5 * n // 256) * 64


@dataclass(frozen=True)
class Counts:
    """What the card counted: pairs blended, pairs wanted, and whether an input (1) or gradient (2) was not finite."""

    n_pairs: int
    n_wanted: int
    not_finite: int


def sh_bytes(n: int, n_sh: int) -> int:
    """Return the size of the harmonics of `pack_sh` in bytes."""
    return 4 * 3 * n_sh * BLOCK * -(-n // BLOCK)


def sh_ranges(n: int, n_sh: int, max_bytes: int) -> list[tuple[int, int, int, int]]:
    """Return ranges of at most `max_bytes` of the harmonics of `pack_sh`: first Gaussian, end, first byte, bytes.

    The end is that of a block. Without harmonics there are 16 bytes.
    """
    row = sh_bytes(1, max(n_sh, 1))
    per_range = max(1, max_bytes // row)
    ranges = []
    for first in range(0, -(-n // BLOCK), per_range):
        last = min(first + per_range, -(-n // BLOCK))
        ranges.append((first * BLOCK, last * BLOCK, first * row, (last - first) * row if n_sh else 16))
    return ranges


def pack_sh(sh: Float32) -> Float32:
    """Return harmonics [N, n_sh, 3] in blocks of 64 Gaussians, [blocks, n_sh * 3, 64], padded with zeros."""
    n, n_sh = sh.shape[:2]
    blocks = -(-n // BLOCK)
    padded = np.zeros((blocks * BLOCK, n_sh * 3), np.float32)
    padded[:n] = sh.reshape(n, n_sh * 3)
    return np.ascontiguousarray(padded.reshape(blocks, BLOCK, n_sh * 3).transpose(0, 2, 1))


def unpack_sh(packed: Float32, n: int, n_sh: int) -> Float32:
    """Return the harmonics [n, n_sh, 3] of `pack_sh`."""
    rows = packed.reshape(-1, n_sh * 3, BLOCK).transpose(0, 2, 1).reshape(-1, n_sh, 3)
    return np.ascontiguousarray(rows[:n])
