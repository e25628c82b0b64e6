"""How torch uses the processor."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator

import torch
from threadpoolctl import threadpool_limits

# Instruction sets with products of bfloat16: those of AMD since Zen 4, and of Intel's servers since Cooper Lake.
_INSTRUCTIONS = ("avx512_bf16", "amx_bf16")


@functools.cache
def multiplies_bfloat16() -> bool:
    """Return whether the processor has instructions for products in bfloat16, without which torch is slower in it."""
    found = torch.cpu.get_capabilities()
    return any(found.get(name, False) for name in _INSTRUCTIONS)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch's own operations, and the linear algebra of NumPy, to one thread.

    Their threads wait for each other by spinning, which costs small operations more CPU time than a second thread
    gains, and slows them down on a machine with other work. See docs/design_notes/training.md.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1, "blas"):
            yield
    finally:
        torch.set_num_threads(before)
