"""Compilation of all kernels (the ``cpu`` backend, the loss and Adam) before their first use.

Kernels are compiled once per computer and then loaded from a cache. Numba compiles on one core, so a child process
compiles half of the kernels at the same time and leaves them in the cache.
"""

from __future__ import annotations

import contextlib
import logging

import torch

from ..core.child_process import child_beside
from ..core.errors import HeritageError
from ..core.system import usable_cores
from ..rasterizer import (
    JIT,
    cache_folder,
    compile_backward,
    compile_forward,
    garbage_collection_paused,
)
from .adam import AdamState, adam_step
from .losses import photometric_loss

_LOG = logging.getLogger(__name__)


def compile_kernels() -> None:
    """Compile every kernel, or load it from the cache.

    Call it before training, so that the first step does not wait for the compiler.
    """
    marker = cache_folder() / "compiled"
    use_second_process = JIT["cache"] and len(usable_cores()) > 1 and not marker.exists()
    with garbage_collection_paused(), contextlib.ExitStack() as context:
        helper = None
        if use_second_process:
            work = child_beside("training.compilation:compile_second_half", {}, what="compiling kernels")
            helper = context.enter_context(work)
        compile_forward()
        if helper is not None:
            try:
                helper.result()
            except HeritageError as error:
                _LOG.warning("the second compiling process failed, this one does its work: %s", error)
        compile_second_half()
    if JIT["cache"]:
        marker.touch()


def compile_second_half() -> None:
    """Compile the end of the backward pass, the loss and Adam; in the child process, too."""
    with garbage_collection_paused():
        compile_backward()
        image = torch.zeros(16, 16, 3, requires_grad=True)
        photometric_loss(image, torch.zeros(16, 16, 3)).backward()
        parameter = torch.zeros(1, 3)
        adam_step([(parameter, torch.zeros(1, 3), 1e-3)], [AdamState.zeros_like(parameter)])
