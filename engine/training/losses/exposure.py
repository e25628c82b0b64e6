"""Brightness factors of photos in training on a card, with the moments of Adam."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from ...core.arrays import Float32
from ...rasterizer.gpu import STORAGE, Gpu
from ..adam import AdamState


class GpuExposures:
    """Logarithms of the brightness factors of V views, one for each colour.

    Parameters
    ----------
    values : float32 array of shape [V, 3]
        0 leaves a photo as it is.
    moments : AdamState, optional
        Zero by default.

    Attributes
    ----------
    buffers : dict of str to wgpu.GPUBuffer
        ``exposure`` and its moments ``exposure_mean`` and ``exposure_square`` [V, 3]; ``in_use`` [V], see `use`.
    step : int
        Number of Adam's steps.

    Raises
    ------
    ValueError
        If the shape is wrong.
    """

    def __init__(self, gpu: Gpu, values: Float32, moments: AdamState | None = None) -> None:
        if values.ndim != 2 or values.shape[1] != 3 or not len(values):
            raise ValueError(f"exposures have shape [V, 3], got {values.shape}")
        self._gpu, self.n = gpu, len(values)
        self._used: tuple[int, ...] = ()
        self.buffers: dict[str, Any] = {
            name: gpu.device.create_buffer(size=12 * self.n, usage=STORAGE, label=name)
            for name in ("exposure", "exposure_mean", "exposure_square")
        }
        self.write(values, moments)
        self.buffers["in_use"] = gpu.device.create_buffer(size=4 * self.n, usage=STORAGE, label="in_use")

    def write(self, values: Float32, moments: AdamState | None = None) -> None:
        """Replace the values [V, 3] and their moments, which are zero by default."""
        zeros = np.zeros((self.n, 3), np.float32)
        mean, square = (zeros, zeros) if moments is None else (moments.mean.numpy(), moments.square.numpy())
        self.step = 0 if moments is None else moments.step
        for name, array in (("exposure", values), ("exposure_mean", mean), ("exposure_square", square)):
            self._gpu.device.queue.write_buffer(self.buffers[name], 0, np.ascontiguousarray(array, np.float32))

    def use(self, views: Sequence[int]) -> None:
        """Set the views whose mean is subtracted after the next steps."""
        if tuple(views) != self._used:
            self._used = tuple(views)
            flags = np.zeros(self.n, np.uint32)
            flags[list(views)] = 1
            self._gpu.device.queue.write_buffer(self.buffers["in_use"], 0, flags)

    def values(self) -> Float32:
        """Return a copy of the values, shape [V, 3]."""
        return self._read("exposure")

    def moments(self) -> AdamState:
        """Return a copy of the moments."""
        mean, square = (torch.from_numpy(self._read(f"exposure_{part}")) for part in ("mean", "square"))
        return AdamState(mean, square, self.step)

    def _read(self, name: str) -> Float32:
        data = self._gpu.device.queue.read_buffer(self.buffers[name], 0, 12 * self.n)
        return np.frombuffer(data, np.float32).reshape(self.n, 3).copy()
