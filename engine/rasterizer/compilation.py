"""Compilation of all kernels (the ``cpu`` backend, the loss and Adam) before their first use.

Kernels are compiled once per computer and then loaded from a cache. Numba compiles on one core, so a second process,
``python -m engine.rasterizer.compilation``, compiles half of the kernels at the same time and leaves them in the cache.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import torch

from ..scene import PinholeCamera
from .adam import AdamState, adam_step
from .api import rasterize
from .blend_backward import MOMENTS_SIZE
from .cpu import View, gaussian_gradients, pair_gradients
from .jit import JIT, cache_folder
from .loss import photometric_loss
from .projection import Projected
from .settings import RasterSettings
from .threads import n_usable_cores
from .tiles import TileLists

__all__ = ["compile_kernels"]

_log = logging.getLogger(__name__)
_CAMERA = PinholeCamera(np.eye(4), np.array([[20.0, 0, 8], [0, 20, 8], [0, 0, 1]]), 16, 16)


def compile_kernels() -> None:
    """Compile every kernel, or load it from the cache.

    Call it before training, so that the first step does not wait for the compiler.
    """
    marker = cache_folder() / "compiled"
    use_second_process = JIT["cache"] and n_usable_cores() > 1 and not marker.exists()
    # `__package__` is not `engine.rasterizer` inside Blender's extension.
    command = [sys.executable, "-m", f"{__package__}.compilation"]
    with _garbage_collection_paused():
        helper = None
        if use_second_process:
            helper = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        _compile_rendering()
        if helper is not None:
            errors = helper.communicate()[1].decode(errors="replace")
            if helper.returncode:
                _log.warning("the second compiling process failed, this one does its work: %s", errors)
        _compile_learning()
    if JIT["cache"]:
        marker.touch()


def _compile_rendering() -> None:
    """Compile the first half: the forward pass, and the backward pass down to the pairs of a tile and a Gaussian."""
    rasterize(
        torch.tensor([[0.0, 0.0, 2.0]]),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        torch.full((1, 3), 0.2),
        torch.tensor([0.8]),
        camera=_CAMERA,
        sh=torch.zeros(1, 4, 3),
    )
    pair_gradients(_empty_view(), np.zeros((16, 16, 3), np.float32), np.zeros((16, 16), np.float32))


def _compile_learning() -> None:
    """Compile the second half: the backward pass from the pairs to the Gaussians, the loss and Adam."""
    shapes = (0, 3), (0, 4), (0, 3), (0,), (0, 4, 3), (0, 0)
    arrays = tuple(np.zeros(shape, np.float32) for shape in shapes)
    gaussian_gradients(_empty_view(), arrays, np.zeros((0, MOMENTS_SIZE + 4), np.float32), with_pose=False)
    image = torch.zeros(16, 16, 3, requires_grad=True)
    photometric_loss(image, torch.zeros(16, 16, 3)).backward()
    parameter = torch.zeros(1, 3)
    adam_step([(parameter, torch.zeros(1, 3), 1e-3)], [AdamState.zeros_like(parameter)])


def _empty_view() -> View:
    """Return the result of a forward pass without Gaussians on one tile."""
    view = View(_CAMERA, 1, RasterSettings(threads=1), Projected.empty(0, 4))
    no_pairs = np.zeros(0, np.int32)
    view.lists = TileLists(np.zeros(1, np.int64), np.zeros(2, np.int64), no_pairs, no_pairs)
    view.masks, view.geometry = np.zeros(0, np.uint16), np.zeros(0, np.float32)
    return view


@contextlib.contextmanager
def _garbage_collection_paused() -> Iterator[None]:
    """Pause garbage collection while Numba creates millions of objects; it takes an eighth of the compilation time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


if __name__ == "__main__":
    with _garbage_collection_paused():
        _compile_learning()
