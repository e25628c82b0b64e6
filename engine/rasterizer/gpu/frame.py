"""Buffers of one image, and the dispatches of its forward and backward pass.

The forward pass projects, sorts by depth, lists the pairs of a tile and a Gaussian, sorts them by tile and blends. The
number of pairs stays on the card: later steps are dispatched indirectly. If there are more pairs than the buffers hold,
the image is empty and `Frame.counts` says how many are needed; the caller grows the frame and repeats.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import EnvironmentProblem
from ...machine import free_memory
from ...scene import PinholeCamera
from ..settings import JACOBIAN_MARGIN, RasterSettings
from .adapters import Gpu, translate_card_errors
from .layout import BLOCK, Counts, FrameSize
from .shaders import SCAN_BLOCK, SORT_BLOCK, kernels_of
from .submissions import Dispatch as _Step
from .submissions import Submissions, encode

__all__ = ["STORAGE", "Frame"]

Float32 = NDArray[np.float32]

STORAGE = 0x80 | 0x8 | 0x4  # STORAGE | COPY_DST | COPY_SRC of WebGPU
_INDIRECT = 0x100
_UNIFORM = 0x40 | 0x8

SMALLER = "render a smaller picture or fewer Gaussians, or use the CPU"
"""What to do when the buffers of a picture do not fit."""


class Frame:
    """Buffers and dispatches of one size of image on one card.

    Parameters
    ----------
    gpu : Gpu
    size : FrameSize
    n_moving : int, optional
        Number of channels, from the first on, whose gradient reaches the geometry; all by default.
    with_pose : bool
        Whether the backward pass computes the gradient of the camera's pose.
    shared : mapping of str to wgpu.GPUBuffer, optional
        Buffers to use in place of new ones if they are large enough, such as parameters that several frames render.

    Attributes
    ----------
    buffers : dict of str to wgpu.GPUBuffer
        Inputs ``means``, ``quats``, ``scales``, ``opacities``, ``sh`` (see `pack_sh`), ``channels`` and ``gradient``
        [H, W, K + 1] (the last value is that of the transmittance); outputs ``image``, ``transmittance``, ``info``,
        ``gradients`` [N, 12] (mean, quat, scale, opacity, 0), ``sh_gradient``, ``totals`` and ``pose``.

    Raises
    ------
    EnvironmentProblem
        If a buffer is larger than a kernel of this card can see, or memory is full.
    """

    def __init__(
        self,
        gpu: Gpu,
        size: FrameSize,
        *,
        n_moving: int | None = None,
        with_pose: bool = False,
        shared: Mapping[str, Any] | None = None,
    ) -> None:
        self.gpu, self.size = gpu, size
        self._shared = shared or {}
        self._n_moving = size.n_out if n_moving is None else n_moving
        self._with_pose = with_pose
        self.buffers: dict[str, Any] = {}
        self._uniforms: list[tuple[Any, int, int]] = []
        self._view = np.zeros(68, np.uint32)
        self._allocate()
        self._forward = self._submissions(self._forward_steps())
        self._backward = self._submissions(self._backward_steps() if size.backward else [])

    def _allocate(self) -> None:
        s = self.size
        n = max(s.n, 1)
        chunks = -(-s.n_out // 4)
        capacity = max(s.capacity, 1)
        sort = max(n, capacity)
        sizes = {
            "means": 12 * n, "quats": 16 * n, "scales": 12 * n, "opacities": 4 * n,
            "sh": 4 * BLOCK * 3 * s.n_sh * -(-n // BLOCK), "channels": 4 * n * s.n_channels,
            "geometry": 32 * n, "depth_keys": 4 * n, "info": 16 * n, "counts": 16,
            "identity": 4 * n, "offsets": 4 * (n + 1), "ranges": 8 * n, "colors": 16 * chunks * n,
            "keys_0": 4 * sort, "keys_1": 4 * sort, "values_0": 4 * sort, "values_1": 4 * sort,
            "order": 4 * n, "pair_tiles": 4 * capacity, "pair_gaussians": 4 * capacity, "pair_identity": 4 * capacity,
            "digits": 1024 * -(-sort // SORT_BLOCK), "sums": 4 * (-(-max(n + 1, 256 * -(-sort // SORT_BLOCK)) // SCAN_BLOCK)),
            "tile_ranges": 8 * s.n_tiles, "entries": 8 * capacity,
            "image": 4 * s.width * s.height * s.n_out, "transmittance": 8 * s.width * s.height,
        }  # fmt: skip
        if s.backward:
            sizes["transmittance"] += 1024 * (capacity // 32 + s.n_tiles)  # T in front of each batch of 32 Gaussians
            sizes |= {
                "gradient": 4 * s.width * s.height * (s.n_out + 1),
                "rows": 16 * (chunks + 2) * capacity, "totals": 16 * (chunks + 2) * n,
                "gradients": 48 * n, "pose": 48 * n if self._with_pose else 4, "sh_gradient": 4 * BLOCK * 3 * s.n_sh * -(-n // BLOCK),
            }  # fmt: skip
        self.allocate(sizes)
        self.buffers["dispatches"] = self.gpu.device.create_buffer(size=36, usage=STORAGE | _INDIRECT)
        write = self.gpu.device.queue.write_buffer
        write(self.buffers["identity"], 0, np.arange(n, dtype=np.uint32))
        write(self.buffers["pair_identity"], 0, np.arange(capacity, dtype=np.uint32))

    def allocate(self, sizes: Mapping[str, int]) -> None:
        """Make a buffer for each of `sizes` in bytes, unless a shared one is large enough.

        Raises
        ------
        EnvironmentProblem
            If a buffer is larger than a kernel of this card can see, or memory is full.
        """
        fits = {
            name: self._shared[name]
            for name, n_bytes in sizes.items()
            if name in self._shared and self._shared[name].size >= n_bytes
        }
        own = {name: n_bytes for name, n_bytes in sizes.items() if name not in fits}
        self._check_memory(own)
        self.buffers |= fits
        with translate_card_errors(self.gpu, SMALLER):
            for name, n_bytes in own.items():
                self.buffers[name] = self.gpu.device.create_buffer(size=max(16, n_bytes), usage=STORAGE, label=name)

    def _check_memory(self, sizes: Mapping[str, int]) -> None:
        """Refuse buffers of these `sizes` in bytes before any is made.

        A card with memory of its own does not tell through wgpu how much of it is free: there, the driver refuses.
        """
        for name, n_bytes in sizes.items():
            if n_bytes > self.gpu.max_binding_bytes and name not in ("sh", "sh_gradient"):
                raise EnvironmentProblem(
                    f"{self.gpu.name} lets a kernel see {self.gpu.max_binding_bytes >> 20} MiB and this picture of "
                    f"{self.size.width} x {self.size.height} pixels needs {n_bytes >> 20} MiB for `{name}`; {SMALLER}."
                )
        needed, free = sum(sizes.values()), free_memory() if self.gpu.shares_memory else None
        if free is not None and needed > free:
            raise EnvironmentProblem(
                f"this picture of {self.size.width} x {self.size.height} pixels needs {needed >> 20} MiB on "
                f"{self.gpu.name}, and {free >> 20} MiB of memory are free; {SMALLER}."
            )

    @property
    def n_bytes(self) -> int:
        """Memory of all buffers."""
        return sum(buffer.size for buffer in self.buffers.values())

    def write(self, name: str, values: NDArray[Any]) -> None:
        """Copy an array to the buffer `name`."""
        if values.size:
            self.gpu.device.queue.write_buffer(self.buffers[name], 0, np.ascontiguousarray(values))

    def read(self, name: str, shape: Sequence[int], dtype: type = np.float32) -> NDArray[Any]:
        """Return a copy of the buffer `name` from its start on."""
        n_bytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
        if not n_bytes:
            return np.zeros(shape, dtype)
        data = self.gpu.device.queue.read_buffer(self.buffers[name], 0, n_bytes)
        return np.frombuffer(data, dtype).reshape(shape).copy()

    def counts(self) -> Counts:
        """Return what the last forward and backward pass counted."""
        return Counts(*(int(value) for value in self.read("counts", (4,), np.uint32)[1:]))

    def set_view(self, camera: PinholeCamera, settings: RasterSettings, sh_degree: int) -> None:
        """Set the camera, the settings and the highest band of the next passes."""
        self._view = self._packed_view(camera, settings, sh_degree)
        for uniform in self._uniforms:
            self._write_view(*uniform)

    def _write_view(self, buffer: Any, first: int, last: int) -> None:
        self._view[14 * 4 + 8] = np.uint32(first)
        self._view[14 * 4 + 11] = np.uint32(last)
        self.gpu.device.queue.write_buffer(buffer, 0, self._view)

    def _packed_view(self, camera: PinholeCamera, settings: RasterSettings, sh_degree: int) -> NDArray[np.uint32]:
        s = self.size
        K, viewmat = camera.K, np.asarray(camera.viewmat, np.float64)
        fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
        margin_x, margin_y = JACOBIAN_MARGIN * s.width, JACOBIAN_MARGIN * s.height
        values = np.zeros(28)
        values[:9], values[9:12] = viewmat[:3, :3].reshape(-1), viewmat[:3, 3]
        values[12:16] = fx, fy, cx, cy
        values[16:18] = (-margin_x - cx) / fx, (s.width + margin_x - cx) / fx
        values[18:20] = (-margin_y - cy) / fy, (s.height + margin_y - cy) / fy
        values[20:23] = settings.near, settings.low_pass, settings.antialiased
        values[23:26] = camera.center
        with np.errstate(over="ignore", invalid="ignore"):
            high = values.astype(np.float32)
            low = (values - high.astype(np.float64)).astype(np.float32)
        integers = [
            s.n, s.width, s.height, -(-s.width // 16), s.n_tiles, sh_degree, s.n_sh, s.n_rgb, 0, s.capacity,
            int(self._with_pose), s.n,
        ]  # fmt: skip
        return np.concatenate([high.view(np.uint32), low.view(np.uint32), np.array(integers, np.uint32)])

    def _view_uniform(self, first: int = 0, last: int | None = None) -> Any:
        buffer = self._uniform(272)
        self._uniforms.append((buffer, first, self.size.n if last is None else last))
        self._write_view(*self._uniforms[-1])
        return buffer

    def _uniform(self, n_bytes: int) -> Any:
        return self.gpu.device.create_buffer(size=n_bytes, usage=_UNIFORM)

    def _constants(self, *values: int) -> Any:
        buffer = self._uniform(16)
        self.gpu.device.queue.write_buffer(buffer, 0, np.array([*values, 0, 0][:4], np.uint32))
        return buffer

    def _step(
        self,
        stage: str,
        kernel: str,
        uniform: Any,
        names: Sequence[str | tuple[str, int, int]],
        n_groups: int,
        *,
        entry: str = "main",
        indirect: int = -1,
    ) -> _Step:
        """Return the dispatch of `kernel` on the buffers `names`, or on (name, first byte, bytes) of a buffer."""
        pipeline = kernels_of(self.gpu).get(kernel, entry, self.size.n_out, self._n_moving)
        resources = [{"buffer": uniform, "offset": 0, "size": uniform.size}]
        for item in names:
            name, first, n_bytes = (item, 0, self.buffers[item].size) if isinstance(item, str) else item
            resources.append({"buffer": self.buffers[name], "offset": first, "size": n_bytes})
        bindings = self.gpu.device.create_bind_group(
            layout=pipeline.get_bind_group_layout(0),
            entries=[{"binding": i, "resource": resource} for i, resource in enumerate(resources)],
        )
        x = max(1, min(n_groups, 65535))
        return _Step(stage, pipeline, bindings, (x, max(1, -(-n_groups // x))), indirect)

    def _tiles_step(self, stage: str, kernel: str, names: Sequence[str], first: int, end: int) -> _Step:
        """Return the dispatch of a kernel with a workgroup for each tile, for the tiles from `first` to `end`."""
        step = self._step(stage, kernel, self._view_uniform(first, end), names, end - first)
        part = functools.cache(lambda a, b: self._tiles_step(stage, kernel, names, first + a, first + b))
        return replace(step, part=part)

    def _scan(self, stage: str, length: int, per_block: int, values: str, n: int, indirect: int = -1) -> list[_Step]:
        """Return the steps of a prefix sum of `n` values, or of the length that the card knows."""
        settings = self._constants(length, per_block)
        groups = -(-n // SCAN_BLOCK)
        names = ["counts", values, "sums"]
        return [
            self._step(stage, "scan", settings, names, groups, entry="reduce", indirect=indirect),
            self._step(stage, "scan", settings, names, groups, indirect=indirect),
        ]

    def _sort(self, stage: str, length: int, keys: str, values: str, n_bits: int, order: str | None) -> list[_Step]:
        """Return the steps of a radix sort by the lowest `n_bits`; the result is in keys_0/1, values_0/1 or `order`."""
        steps = []
        n_passes = -(-n_bits // 8)
        by_card = length != 0  # the number of pairs is known to the card alone
        groups = -(-self.size.n // SORT_BLOCK)
        for i in range(n_passes):
            settings = self._constants(8 * i, length)
            out_keys, out_values = f"keys_{i % 2}", f"values_{i % 2}"
            if order is not None and i == n_passes - 1:
                out_values = order
            indirect = (0, 3) if by_card else (-1, -1)
            steps.append(
                self._step(stage, "radix_count", settings, ["counts", keys, "digits"], groups, indirect=indirect[0])
            )
            steps += self._scan(stage, length, SORT_BLOCK, "digits", 256 * groups, indirect[1])
            steps.append(
                self._step(
                    stage,
                    "radix_scatter",
                    settings,
                    ["counts", keys, values, "digits", out_keys, out_values],
                    groups,
                    indirect=indirect[0],
                )  # fmt: skip
            )
            keys, values = out_keys, out_values
        self._sorted = keys, values
        return steps

    def _submissions(self, steps: Sequence[_Step]) -> Submissions:
        return Submissions(self.gpu, steps, self.buffers["dispatches"])

    def _color_ranges(self) -> list[tuple[int, int, int, int]]:
        """Return ranges of Gaussians whose harmonics a kernel can see: first, last, first byte, bytes."""
        row = 4 * 3 * max(self.size.n_sh, 1) * BLOCK
        per_range = max(1, self.gpu.max_binding_bytes // row)
        n_blocks = -(-max(self.size.n, 1) // BLOCK)
        ranges = []
        for first in range(0, n_blocks, per_range):
            last = min(first + per_range, n_blocks)
            n_bytes = (last - first) * row if self.size.n_sh else 16
            ranges.append((first * BLOCK, min(last * BLOCK, self.size.n), first * row, n_bytes))
        return ranges

    def _forward_steps(self) -> list[_Step]:
        s = self.size
        view = self._view_uniform()
        steps = [
            self._step(
                "projection", "project", view,
                ["means", "quats", "scales", "opacities", "geometry", "depth_keys", "info", "counts"], -(-s.n // 128),
            )
        ]  # fmt: skip
        for first, last, at, n_bytes in self._color_ranges():
            steps.append(
                self._step(
                    "colours",
                    "colors",
                    self._view_uniform(first, last),
                    ["means", ("sh", at, n_bytes), "channels", "colors", "counts"],
                    -(-(last - first) // BLOCK),
                )  # fmt: skip
            )
        steps += self._sort("depth sort", 0, "depth_keys", "identity", 32, "order")
        steps.append(self._step("pairs", "gather", view, ["info", "order", "offsets"], s.n // 256 + 1))
        steps += self._scan("pairs", 0, 0, "offsets", s.n + 1)
        steps.append(self._step("pairs", "prepare", view, ["offsets", "counts", "dispatches"], 1))
        steps.append(
            self._step(
                "pairs", "emit", view,
                ["geometry", "info", "order", "offsets", "pair_tiles", "pair_gaussians", "ranges", "counts"], -(-s.n // 128),
            )
        )  # fmt: skip
        steps += self._sort("tile sort", 1, "pair_tiles", "pair_identity", s.n_tiles.bit_length(), None)
        steps.append(
            self._step(
                "tile sort", "lists", view, [*self._sorted, "pair_gaussians", "counts", "tile_ranges", "entries"], 1,
                indirect=6,
            )
        )  # fmt: skip
        names = ["geometry", "entries", "tile_ranges", "colors", "image", "transmittance"]
        steps.append(self._tiles_step("blending", "blend", names, 0, s.n_tiles))
        return steps

    def _backward_steps(self) -> list[_Step]:
        s = self.size
        view = self._uniforms[0][0]
        chunks = -(-s.n_out // 4)
        steps = [
            self._tiles_step(
                "blending backward", "blend_backward",
                ["geometry", "entries", "tile_ranges", "colors", "gradient", "transmittance", "rows", "counts"], 0, s.n_tiles,
            ),
            self._step("segment sum", "sum_pairs", view, ["ranges", "rows", "totals"], -(-s.n * (chunks + 2) // 128)),
            self._step(
                "projection backward", "project_backward", view,
                ["means", "quats", "scales", "opacities", "info", "totals", "gradients", "pose"], -(-s.n // 64),
            ),
        ]  # fmt: skip
        if s.n_sh:
            for first, last, at, n_bytes in self._color_ranges():
                steps.append(
                    self._step(
                        "colours backward",
                        "colors_backward",
                        self._view_uniform(first, last),
                        [
                            "means",
                            ("sh", at, n_bytes),
                            "info",
                            "colors",
                            "totals",
                            ("sh_gradient", at, n_bytes),
                            "gradients",
                            "pose",
                        ],
                        -(-(last - first) // BLOCK),
                    )  # fmt: skip
                )
        return steps

    def forward(self, time: Callable[[str, Any], Any] | None = None) -> None:
        """Queue the forward pass. `time` gives the descriptor of a compute pass for each stage, to measure it."""
        counts = np.array([self.size.n, 0, 0, 0], np.uint32)
        self.gpu.device.queue.write_buffer(self.buffers["counts"], 0, counts)
        self._submit(self._forward, ["tile_ranges"], time)

    def backward(self, time: Callable[[str, Any], Any] | None = None) -> None:
        """Queue the backward pass, from ``gradient`` to the gradients of all inputs."""
        self._submit(self._backward, [], time)

    def _submit(self, run: Submissions, zeroed: Sequence[str], time: Callable[[str, Any], Any] | None = None) -> None:
        """Queue the dispatches of `run` in submissions of bounded time, or with `time` in one."""
        buffers = [self.buffers[name] for name in zeroed]
        if time is None:
            run.run(buffers)
            return
        encoder = self.gpu.device.create_command_encoder()
        for buffer in buffers:
            encoder.clear_buffer(buffer)
        encode(encoder, run.dispatches, self.buffers["dispatches"], time)
        self.gpu.device.queue.submit([encoder.finish()])
