"""Constants of kernels that change from run to run, in few buffers that are copied to the card together.

A write to the card costs the processor about as much as queueing ten kernels, however little is written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .adapters import Gpu

_UNIFORM = 0x40 | 0x8  # UNIFORM | COPY_DST of WebGPU

_ALIGNED = 256
"""Multiple of bytes at which a uniform may begin; no card asks for more."""

_BLOCK_BYTES = 16384


class _Block:
    """One buffer, and its copy in the computer's memory."""

    def __init__(self, gpu: Gpu, n_bytes: int) -> None:
        self.buffer = gpu.device.create_buffer(size=n_bytes, usage=_UNIFORM, label="constants")
        self.values = np.zeros(n_bytes, np.uint8)
        self.used = 0
        self.changed = False


@dataclass(frozen=True)
class Uniform:
    """A place for the constants of a kernel."""

    block: _Block
    first: int
    n_bytes: int

    @property
    def resource(self) -> dict[str, Any]:
        """What a bind group refers to."""
        return {"buffer": self.block.buffer, "offset": self.first, "size": self.n_bytes}

    def write(self, values: NDArray[Any]) -> None:
        """Set the constants of the runs that are queued from now on."""
        self.block.values[self.first : self.first + values.nbytes] = values.view(np.uint8)
        self.block.changed = True


class Constants:
    """The uniforms of one workspace."""

    def __init__(self, gpu: Gpu) -> None:
        self._gpu = gpu
        self._blocks: list[_Block] = []

    def uniform(self, n_bytes: int) -> Uniform:
        """Return a new place for so many bytes, a multiple of 16."""
        if not self._blocks or self._blocks[-1].used + n_bytes > _BLOCK_BYTES:
            self._blocks.append(_Block(self._gpu, _BLOCK_BYTES))
        block = self._blocks[-1]
        first = block.used
        block.used = -(-(first + n_bytes) // _ALIGNED) * _ALIGNED
        return Uniform(block, first, n_bytes)

    def send(self) -> None:
        """Copy what has changed to the card, before what is queued next."""
        for block in self._blocks:
            if block.changed:
                self._gpu.device.queue.write_buffer(block.buffer, 0, block.values, 0, block.used)
                block.changed = False
