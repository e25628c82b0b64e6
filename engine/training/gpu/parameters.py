"""Gaussians in training on a card: their parameters and the moments of Adam, copied there and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from ...core.arrays import Float32
from ...rasterizer.gpu import (
    STORAGE,
    Gpu,
    pack_sh,
    sh_bytes,
    translate_card_errors,
    unpack_sh,
    wait_until_done,
)
from ..adam import AdamState

GROUPS = ("means", "quats", "log_scales", "opacity_logits", "sh_dc", "sh_rest", "features")
"""Values that are trained with a learning rate of their own, in the order of optimiser.wgsl."""

_COLUMNS = {"means": slice(0, 3), "quats": slice(3, 7), "log_scales": slice(7, 10), "opacity_logits": slice(10, 11)}
"""Columns of the rows of moments, which are those of the gradients."""


class GpuParameters:
    """N Gaussians in training.

    Parameters
    ----------
    values : mapping of str to float32 array of shape [N, ...]
        By the names of `GROUPS`: means [N, 3], quats [N, 4], log_scales [N, 3], opacity_logits [N], sh_dc [N, 1, 3],
        and if they are trained sh_rest [N, 3 | 8 | 15, 3] and features [N, C].
    moments : mapping of str to AdamState, optional
        Moments of the same names; zero by default.
    n_background : int
        The first so many Gaussians train their features alone.
    room : int
        Gaussians that the buffers hold, if that is more than N.
    reuse : dict of str to wgpu.GPUBuffer, optional
        Buffers of earlier Gaussians that are gone: those that are large enough are used. Emptied.

    Attributes
    ----------
    room : int
        Gaussians that the buffers hold.
    buffers : dict of str to wgpu.GPUBuffer
        ``means``, ``quats``, ``log_scales``, ``opacity_logits``, ``sh`` (see `pack_sh`) and ``features``; the activated
        ``scales``, ``opacities`` and ``channels``; the moments ``rows_mean``, ``sh_mean``, ``features_mean`` and
        likewise ``..._square``.
    steps : dict of str to int
        Number of Adam's steps of each group.

    Raises
    ------
    EnvironmentProblem
        If the card's memory is full.
    """

    def __init__(
        self,
        gpu: Gpu,
        values: Mapping[str, Float32],
        moments: Mapping[str, AdamState] | None = None,
        *,
        n_background: int = 0,
        room: int = 0,
        reuse: dict[str, Any] | None = None,
    ) -> None:
        self._gpu = gpu
        self.names = tuple(name for name in GROUPS if name in values)
        self.n, self.n_background = len(values["means"]), n_background
        self.room = max(self.n, room)
        self.n_sh = 1 + (values["sh_rest"].shape[1] if "sh_rest" in values else 0)
        self.n_features = values["features"].shape[1] if "features" in values else 0
        if moments is None:
            moments = {name: AdamState.zeros_like(torch.empty(values[name].shape)) for name in self.names}
        self.steps = {name: moments[name].step for name in self.names}
        arrays: dict[str, Float32] = {
            **{name: values[name] for name in _COLUMNS},
            "sh": self._packed(values),
            "features": values.get("features", np.zeros(0, np.float32)),
        }
        for part in ("mean", "square"):
            group = {name: getattr(moments[name], part).numpy() for name in self.names}
            rows = np.zeros((self.n, 12), np.float32)
            for name, columns in _COLUMNS.items():
                rows[:, columns] = group[name].reshape(self.n, -1)
            arrays |= {
                f"rows_{part}": rows,
                f"sh_{part}": self._packed(group),
                f"features_{part}": group.get("features", np.zeros(0, np.float32)),
            }
        self.buffers: dict[str, Any] = {}
        held = reuse if reuse is not None else {}
        with translate_card_errors(gpu, "train fewer Gaussians, or use the CPU"):
            for name, n_bytes in self._sizes().items():
                buffer = held.pop(name, None)
                if buffer is None or buffer.size < n_bytes:
                    if buffer is not None:
                        wait_until_done(gpu, buffer)
                    buffer = None  # freed before the new one is made
                    buffer = self._buffer(name, n_bytes)
                self.buffers[name] = buffer
            for name, array in arrays.items():
                self.write(name, array)

    def _sizes(self) -> dict[str, int]:
        """Return the sizes of the buffers in bytes."""
        n, harmonics, features = self.room, sh_bytes(self.room, self.n_sh), 4 * self.room * self.n_features
        moments = {"rows": 48 * n, "sh": harmonics, "features": features}
        return {
            "means": 12 * n, "quats": 16 * n, "log_scales": 12 * n, "opacity_logits": 4 * n, "sh": harmonics,
            "features": features, "scales": 12 * n, "opacities": 4 * n, "channels": features,
            **{f"{name}_{part}": n_bytes for part in ("mean", "square") for name, n_bytes in moments.items()},
        }  # fmt: skip

    def _buffer(self, name: str, n_bytes: int) -> Any:
        return self._gpu.device.create_buffer(size=max(16, n_bytes), usage=STORAGE, label=name)

    def write(self, name: str, values: Float32) -> None:
        """Copy an array to the start of the buffer `name`."""
        if values.size:
            self._gpu.device.queue.write_buffer(self.buffers[name], 0, np.ascontiguousarray(values, np.float32))

    def reserve(self, room: int) -> None:
        """Make room for so many Gaussians, in new buffers with the same contents.

        Raises
        ------
        EnvironmentProblem
            If the card's memory is full.
        """
        if room <= self.room:
            return
        self.room = room
        device = self._gpu.device
        with translate_card_errors(self._gpu, "train fewer Gaussians, or use the CPU"):
            for name, n_bytes in self._sizes().items():
                old = self.buffers[name]
                if old.size < n_bytes:
                    self.buffers[name] = self._buffer(name, n_bytes)
                    encoder = device.create_command_encoder()
                    encoder.copy_buffer_to_buffer(old, 0, self.buffers[name], 0, old.size)
                    device.queue.submit([encoder.finish()])
                    wait_until_done(self._gpu, old)  # so that it is freed before the next new one is made

    def geometry(self) -> dict[str, Float32]:
        """Return copies of means, quats, log_scales and opacity_logits."""
        return {name: self._read(name, shape) for name, shape in self._shapes().items()}

    def values(self) -> dict[str, Float32]:
        """Return copies of the values by name."""
        return (
            self.geometry() | self._bands("sh") | ({"features": self._features("features")} if self.n_features else {})
        )

    def moments(self) -> dict[str, AdamState]:
        """Return copies of the moments by name."""
        parts = []
        for part in ("mean", "square"):
            rows = self._read(f"rows_{part}", (self.n, 12))
            found = {name: rows[:, _COLUMNS[name]].reshape(shape) for name, shape in self._shapes().items()}
            found |= self._bands(f"sh_{part}")
            if self.n_features:
                found["features"] = self._features(f"features_{part}")
            parts.append({name: torch.from_numpy(np.ascontiguousarray(value)) for name, value in found.items()})
        return {name: AdamState(parts[0][name], parts[1][name], self.steps[name]) for name in self.names}

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        return {"means": (self.n, 3), "quats": (self.n, 4), "log_scales": (self.n, 3), "opacity_logits": (self.n,)}

    def _packed(self, values: Mapping[str, Float32]) -> Float32:
        bands = [values["sh_dc"], values["sh_rest"]] if "sh_rest" in self.names else [values["sh_dc"]]
        return pack_sh(np.concatenate(bands, axis=1))

    def _bands(self, name: str) -> dict[str, Float32]:
        packed = self._read(name, (sh_bytes(self.n, self.n_sh) // 4,))
        sh = unpack_sh(packed, self.n, self.n_sh)
        bands = {"sh_dc": sh[:, :1], "sh_rest": sh[:, 1:]} if self.n_sh > 1 else {"sh_dc": sh}
        return {band: np.ascontiguousarray(value) for band, value in bands.items()}

    def _features(self, name: str) -> Float32:
        return self._read(name, (self.n, self.n_features))

    def _read(self, name: str, shape: Sequence[int]) -> Float32:
        data = self._gpu.device.queue.read_buffer(self.buffers[name], 0, 4 * int(np.prod(shape)))
        return np.frombuffer(data, np.float32).reshape(shape).copy()
