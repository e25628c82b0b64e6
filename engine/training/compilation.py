"""Compilation of all kernels (the ``cpu`` backend, the loss and Adam) before their first use.

Kernels are compiled once per computer and then loaded from a cache. Numba compiles on one core, so a second process,
``python -m engine.training.compilation``, compiles half of the kernels at the same time and leaves them in the cache.
"""

from __future__ import annotations

import logging
import subprocess
import sys

import torch

from ..rasterizer import (
    JIT,
    cache_folder,
    compile_backward,
    compile_forward,
    garbage_collection_paused,
    n_usable_cores,
)
from .adam import AdamState, adam_step
from .losses import photometric_loss

__all__ = ["compile_kernels"]

_log = logging.getLogger(__name__)


def compile_kernels() -> None:
    """Compile every kernel, or load it from the cache.

    Call it before training, so that the first step does not wait for the compiler.
    """
    marker = cache_folder() / "compiled"
    use_second_process = JIT["cache"] and n_usable_cores() > 1 and not marker.exists()
    # `__package__` is not `engine.training` inside Blender's extension.
    command = [sys.executable, "-m", f"{__package__}.compilation"]
    with garbage_collection_paused():
        helper = None
        if use_second_process:
            helper = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        compile_forward()
        if helper is not None:
            errors = helper.communicate()[1].decode(errors="replace")
            if helper.returncode:
                _log.warning("the second compiling process failed, this one does its work: %s", errors)
        _compile_second_half()
    if JIT["cache"]:
        marker.touch()


def _compile_second_half() -> None:
    """Compile the end of the backward pass, the loss and Adam."""
    compile_backward()
    image = torch.zeros(16, 16, 3, requires_grad=True)
    photometric_loss(image, torch.zeros(16, 16, 3)).backward()
    parameter = torch.zeros(1, 3)
    adam_step([(parameter, torch.zeros(1, 3), 1e-3)], [AdamState.zeros_like(parameter)])


if __name__ == "__main__":
    with garbage_collection_paused():
        _compile_second_half()
