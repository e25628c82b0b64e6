"""Gaussians in training moved, copied and removed on the card."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...rasterizer.gpu import Dispatch, Gpu, encode, sh_bytes, sh_ranges
from .parameters import GpuParameters
from .workspace import TrainingWorkspace

_FRESH = np.uint32(1 << 31)  # as in gather_rows.wgsl


def check_rearrangement(
    parameters: GpuParameters, geometry: Mapping[str, torch.Tensor], sources: torch.Tensor, fresh: torch.Tensor
) -> None:
    """Raise ValueError if the arguments of `GpuTrainer.rearrange` do not fit each other or `parameters`."""
    m = len(sources)
    shapes = {"means": (m, 3), "quats": (m, 4), "log_scales": (m, 3), "opacity_logits": (m,)}
    found = {name: tuple(value.shape) for name, value in geometry.items()}
    if found != shapes or any(value.dtype != torch.float32 for value in geometry.values()):
        raise ValueError(f"the geometry of {m} Gaussians is float32 {shapes}, got {found}")
    if sources.ndim != 1 or sources.dtype != torch.int64 or fresh.shape != sources.shape or fresh.dtype != torch.bool:
        raise ValueError(f"{m} Gaussians have int64 sources and bool `fresh`, got {sources.dtype}, {fresh.dtype}")
    if m < max(1, parameters.n_background):
        raise ValueError(f"at least the {parameters.n_background} Gaussians of the background and one stay, got {m}")
    if int(sources.min()) < 0 or int(sources.max()) >= parameters.n:
        raise ValueError(f"sources are 0 to {parameters.n - 1}, got {int(sources.min())} to {int(sources.max())}")


class Rearrangement(TrainingWorkspace):
    """Gathers the rows of features, harmonics and moments in place, through buffers of the pool.

    Parameters
    ----------
    parameters : GpuParameters
        With room for the new number of Gaussians.
    pool : dict of str to wgpu.GPUBuffer
    """

    def __init__(self, gpu: Gpu, parameters: GpuParameters, pool: dict[str, Any]) -> None:
        super().__init__(gpu, f"the rearrangement of {parameters.n} Gaussians", shared=parameters.buffers, pool=pool)
        room, n_features = parameters.room, parameters.n_features
        self._parameters = parameters
        sh_size = sh_bytes(room, parameters.n_sh)
        self.allocate({"sources": 4 * room, "totals": max(48, 4 * n_features) * room, "sh_gradient": sh_size})
        self.buffers |= parameters.buffers

    def run(self, sources: NDArray[np.int64], fresh: NDArray[np.bool_]) -> None:
        """Queue the change to ``len(sources)`` Gaussians; see `GpuTrainer.rearrange`."""
        packed = sources.astype(np.uint32) | np.where(fresh, _FRESH, np.uint32(0))
        self.write("sources", packed)
        m, n_sh, n_features = len(packed), self._parameters.n_sh, self._parameters.n_features
        encoder = self.gpu.device.create_command_encoder()
        for name, clears in (("sh", False), ("sh_mean", True), ("sh_square", True)):
            self._gather(encoder, name, "sh_gradient", self._sh_steps(name, m, clears), sh_bytes(m, n_sh))
        names = [("rows_mean", 12, True), ("rows_square", 12, True)]
        if n_features:
            features = (("features", False), ("features_mean", True), ("features_square", True))
            names += [(name, n_features, clears) for name, clears in features]
        for name, width, clears in names:
            settings = self._constants(m, width, clears)
            step = self._step("gather", "gather_rows", settings, ["sources", name, "totals"], -(-m * width // 128))
            self._gather(encoder, name, "totals", [step], 4 * m * width)
        self.gpu.device.queue.submit([encoder.finish()])

    def _sh_steps(self, name: str, m: int, clears: bool) -> list[Dispatch]:
        """Return the dispatches for each part of the old harmonics and each part of the new ones."""
        n_sh = self._parameters.n_sh
        ranges = sh_ranges(self._parameters.room, n_sh, self.gpu.max_binding_bytes)
        return [
            self._step(
                "gather", "gather_sh", self._constants(m, n_sh, clears, first, source_first, source_end),
                ["sources", (name, source_at, source_bytes), ("sh_gradient", at, n_bytes)], -(-n_bytes // 512),
            )
            for first, _, at, n_bytes in ranges if first < m
            for source_first, source_end, source_at, source_bytes in ranges if source_first < self._parameters.n
        ]  # fmt: skip

    def _gather(self, encoder: Any, name: str, through: str, steps: list[Dispatch], n_bytes: int) -> None:
        """Add to `encoder` the dispatches that write the new values to `through`, and the copy to the buffer `name`."""
        encode(encoder, steps, None)
        encoder.copy_buffer_to_buffer(self.buffers[through], 0, self.buffers[name], 0, n_bytes)
