"""Compilation of the kernels of the ``cpu`` backend before their first use, in two parts that take about as long."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator

import numpy as np
import torch

from ..scene import PinholeCamera
from .api import rasterize
from .blend_backward import MOMENTS_SIZE
from .cpu import View, gaussian_gradients, pair_gradients
from .projection import Projected
from .settings import RasterSettings
from .tiles import TileLists

_CAMERA = PinholeCamera(np.eye(4), np.array([[20.0, 0, 8], [0, 20, 8], [0, 0, 1]]), 16, 16)


def compile_forward() -> None:
    """Compile the forward pass, and the backward pass down to the pairs of a tile and a Gaussian."""
    rasterize(
        torch.tensor([[0.0, 0.0, 2.0]]),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        torch.full((1, 3), 0.2),
        torch.tensor([0.8]),
        camera=_CAMERA,
        sh=torch.zeros(1, 4, 3),
    )
    pair_gradients(_empty_view(), np.zeros((16, 16, 3), np.float32), np.zeros((16, 16), np.float32))


def compile_backward() -> None:
    """Compile the backward pass from the pairs to the Gaussians."""
    shapes = (0, 3), (0, 4), (0, 3), (0,), (0, 4, 3), (0, 0)
    arrays = tuple(np.zeros(shape, np.float32) for shape in shapes)
    gaussian_gradients(_empty_view(), arrays, np.zeros((0, MOMENTS_SIZE + 4), np.float32), with_pose=False)


def _empty_view() -> View:
    """Return the result of a forward pass without Gaussians on one tile."""
    view = View(_CAMERA, 1, RasterSettings(threads=1), Projected.empty(0, 4))
    no_pairs = np.zeros(0, np.int32)
    view.lists = TileLists(np.zeros(1, np.int64), np.zeros(2, np.int64), no_pairs, no_pairs)
    view.masks, view.geometry = np.zeros(0, np.uint16), np.zeros(0, np.float32)
    return view


@contextlib.contextmanager
def garbage_collection_paused() -> Iterator[None]:
    """Pause garbage collection while Numba creates millions of objects; it takes an eighth of the compilation time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
