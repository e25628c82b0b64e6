"""Compile the kernels of the ``cpu`` backend, the loss and Adam, once per computer; later this loads them.

Numba compiles on one core. So a second process takes the kernels that the first does not need at once, and leaves them
in the cache: ``python -m engine.rasterizer.compilation`` is that process.
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
from .blend_backward import MOMENTS
from .cpu import View, gaussian_gradients, pair_gradients
from .jit import JIT, cache_folder
from .loss import photometric_loss
from .projection import Projected
from .settings import RasterSettings
from .threads import n_usable_cores
from .tiles import TileLists

__all__ = ["warm_up"]

_log = logging.getLogger(__name__)
_CAMERA = PinholeCamera(np.eye(4), np.array([[20.0, 0, 8], [0, 20, 8], [0, 0, 1]]), 16, 16)


def warm_up() -> None:
    """Compile every kernel, or load those in the cache."""
    compiled = cache_folder() / "compiled"
    shares = JIT["cache"] and n_usable_cores() > 1 and not compiled.exists()
    # By the package's own name: inside Blender's extension it is not `engine`.
    command = [sys.executable, "-m", f"{__package__}.warm_up"]
    with _no_garbage_collection():
        other = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) if shares else None
        _compile_pictures()
        if other is not None:
            complaint = other.communicate()[1].decode(errors="replace")
            if other.returncode:
                _log.warning("the second compiling process failed, this one does its work: %s", complaint)
        _compile_learning()
    if JIT["cache"]:
        compiled.touch()


def _compile_pictures() -> None:
    """Compile a picture's forward pass and its gradient as far as the pairs of a tile and a Gaussian: half the work."""
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
    """Compile the other half: the gradient from the pairs to the Gaussians, the loss and Adam."""
    shapes = (0, 3), (0, 4), (0, 3), (0,), (0, 4, 3), (0, 0)
    arrays = tuple(np.zeros(shape, np.float32) for shape in shapes)
    gaussian_gradients(_empty_view(), arrays, np.zeros((0, MOMENTS + 4), np.float32), with_pose=False)
    picture = torch.zeros(16, 16, 3, requires_grad=True)
    photometric_loss(picture, torch.zeros(16, 16, 3)).backward()
    parameter = torch.zeros(1, 3)
    adam_step([(parameter, torch.zeros(1, 3), 1e-3)], [AdamState.zeros_like(parameter)])


def _empty_view() -> View:
    """Return what the forward pass leaves of a scene without Gaussians, on one tile."""
    view = View(_CAMERA, 1, RasterSettings(threads=1), Projected.empty(0, 4))
    nobody = np.zeros(0, np.int32)
    view.lists = TileLists(np.zeros(1, np.int64), np.zeros(2, np.int64), nobody, nobody)
    view.masks, view.geometry = np.zeros(0, np.uint16), np.zeros(0, np.float32)
    return view


@contextlib.contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Keep Python from looking for garbage while Numba makes millions of objects; an eighth of the time to compile."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


if __name__ == "__main__":
    with _no_garbage_collection():
        _compile_learning()
