"""Items shared between threads, and the tests for values that are not finite."""

from __future__ import annotations

import gc

import numpy as np
import pytest
import torch
from numba import njit
from numba.core.runtime import _nrt_python, rtsys
from numpy.typing import NDArray

from engine.rasterizer.api import rasterize
from engine.rasterizer.finite import all_finite
from engine.rasterizer.threads import Share, new_counters, run_shared, take_range
from engine.training.adam import AdamState, adam_step
from engine.training.losses.photometric import Target, photometric_loss
from tests.engine.rasterizer.scenes import camera, random_scene


@njit(nogil=True)
def _count(share: Share, times: NDArray[np.int64]) -> None:
    n = times.shape[0]
    first, last = take_range(share, n, 3)
    while first < last:
        for i in range(first, last):
            times[i] += 1
        first, last = take_range(share, n, 3)


@pytest.mark.parametrize("n_items", [0, 1, 2, 3, 4, 10_000])
@pytest.mark.parametrize("n_threads", [1, 2, 7])
def test_every_item_is_processed_once_with_any_number_of_threads(n_items: int, n_threads: int) -> None:
    times = np.zeros(n_items, np.int64)
    run_shared(lambda share: _count(share, times), n_threads)
    assert (times == 1).all()


@njit(nogil=True)
def _ranges(share: Share, n: int, size: int) -> list[tuple[int, int]]:
    ranges = [take_range(share, n, size)]
    while ranges[-1][0] < ranges[-1][1]:
        ranges.append(take_range(share, n, size))
    return ranges


def test_a_thread_takes_its_own_part_and_then_what_others_leave() -> None:
    counters = new_counters(3)
    assert _ranges(Share(counters, 1), 11, 2) == [(4, 6), (6, 8), (8, 10), (10, 11), (0, 2), (2, 4), (11, 11)]
    assert _ranges(Share(counters, 0), 11, 2) == [(11, 11)]


def test_an_error_on_another_thread_is_raised_here() -> None:
    calls: list[int] = []

    def work(_: Share) -> None:
        calls.append(1)
        if len(calls) == 2:
            raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        run_shared(work, 3)
    assert len(calls) == 3


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", [0, 15, 16, 36])
def test_a_value_that_is_not_finite_is_found_at_any_position(where: int, bad: float, dtype: type) -> None:
    values = np.full((37,), np.finfo(dtype).max, dtype)
    assert all_finite(values)
    assert all_finite(values[::2])
    values[where] = bad
    assert not all_finite(values)
    assert not all_finite(values.reshape(1, 37, 1))


def test_no_kernel_leaks_memory() -> None:
    """Numba's generators leaked memory: training took 4 MB more at every step."""
    scene, view = random_scene(100), camera(70, 50)
    tensors = [scene.means, scene.quats, scene.scales, scene.opacities]
    for tensor in tensors:
        tensor.requires_grad_()
    state = AdamState.zeros_like(scene.means)

    def step() -> None:
        raster = rasterize(*tensors, camera=view, channels=torch.ones(100, 3))
        photometric_loss(raster.image, Target(np.zeros((50, 70, 3), np.uint8))).backward()
        adam_step([(scene.means, scene.means.grad, 0.1)], [state])  # type: ignore[list-item]

    def n_allocations() -> int:
        gc.collect()
        stats = rtsys.get_allocation_stats()
        return int(stats.mi_alloc - stats.mi_free)

    _nrt_python.memsys_enable_stats()
    step()
    before = n_allocations()
    for _ in range(3):
        step()
    assert n_allocations() == before
