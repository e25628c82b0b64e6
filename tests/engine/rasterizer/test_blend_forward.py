"""Each block of a tile lists exactly the Gaussians that touch it, in their order."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from engine.rasterizer.blend_forward import list_block_gaussians


@njit(nogil=True, error_model="numpy")
def listed(masks: np.ndarray, start: int, n: int, block: int, queue: np.ndarray) -> int:
    return list_block_gaussians(masks, start, n, block, queue)


@pytest.mark.parametrize(("start", "n"), [(0, 0), (3, 1), (0, 16), (5, 17), (0, 40), (24, 16), (30, 10), (39, 1)])
@pytest.mark.parametrize("block", [0, 7, 15])
def test_a_block_lists_its_own_gaussians_only(start: int, n: int, block: int) -> None:
    masks = np.random.default_rng(start + n).integers(0, 1 << 16, 40).astype(np.uint16)
    queue = np.full(n + 16, -1, np.int32)
    n_found = listed(masks, start, n, block, queue)
    np.testing.assert_array_equal(queue[:n_found], np.flatnonzero(masks[start : start + n] >> block & 1))
