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

from ...scene import PinholeCamera
from ..settings import JACOBIAN_MARGIN, RasterSettings
from .adapters import Gpu
from .constants import Uniform
from .layout import BLOCK, Counts, FrameSize, sh_bytes, sh_ranges
from .submissions import Dispatch, Submissions, Timings, encode
from .workspace import Workspace


def camera_values(camera: PinholeCamera, settings: RasterSettings) -> NDArray[np.uint32]:
    """Return the camera and the settings as kernels read them, in float32 with what it leaves out; shape [56]."""
    K, viewmat = camera.K, np.asarray(camera.viewmat, np.float64)
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    margin_x, margin_y = JACOBIAN_MARGIN * camera.width, JACOBIAN_MARGIN * camera.height
    values = np.zeros(28)
    values[:9], values[9:12] = viewmat[:3, :3].reshape(-1), viewmat[:3, 3]
    values[12:16] = fx, fy, cx, cy
    values[16:18] = (-margin_x - cx) / fx, (camera.width + margin_x - cx) / fx
    values[18:20] = (-margin_y - cy) / fy, (camera.height + margin_y - cy) / fy
    values[20:23] = settings.near, settings.low_pass, settings.antialiased
    values[23:26] = camera.center
    with np.errstate(over="ignore", invalid="ignore"):
        high = values.astype(np.float32)
        low = (values - high.astype(np.float64)).astype(np.float32)
    return np.concatenate([high.view(np.uint32), low.view(np.uint32)])


class Frame(Workspace):
    """Buffers and dispatches of one size of image on one card.

    Parameters
    ----------
    n_moving : int, optional
        Number of channels, from the first on, whose gradient reaches the geometry; all by default.
    with_pose : bool
        Whether the backward pass computes the gradient of the camera's pose.
    shared, pool : mapping of str to wgpu.GPUBuffer, optional
        See `Workspace`.
    timings : Timings, optional
        Those of other sizes of picture.

    Attributes
    ----------
    buffers : dict of str to wgpu.GPUBuffer
        Inputs ``means``, ``quats``, ``scales``, ``opacities``, ``sh`` (see `pack_sh`), ``channels`` and ``gradient``
        [H, W, K + 1] (the last value is that of the transmittance); outputs ``image``, ``transmittance``, ``info``,
        ``gradients`` [N, 12] (mean, quat, scale, opacity, 0), ``sh_gradient``, ``totals`` and ``pose``. The forward
        pass overwrites the outputs of the backward pass.

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
        pool: dict[str, Any] | None = None,
        timings: Timings | None = None,
    ) -> None:
        what = f"this picture of {size.width} x {size.height} pixels"
        moving = size.n_out if n_moving is None else n_moving
        super().__init__(gpu, what, n_channels=size.n_out, n_moving=moving, shared=shared, pool=pool)
        self.size = size
        self._timings = timings or Timings(gpu)
        self._with_pose = with_pose
        self._uniforms: list[tuple[Uniform, int, Callable[[], int]]] = []
        self._view = np.zeros(68, np.uint32)
        self.allocate(self._sizes())
        self._make_dispatches()
        self._forward = self._submissions(self._forward_steps())
        self._backward = self._submissions(self._backward_steps() if size.backward else [])

    def _sizes(self) -> dict[str, int]:
        """Return the sizes of the buffers in bytes."""
        s, n = self.size, self.size.n_room
        chunks = -(-s.n_out // 4)
        capacity = max(s.capacity, 1)
        sizes = {
            "means": 12 * n, "quats": 16 * n, "scales": 12 * n, "opacities": 4 * n,
            "sh": sh_bytes(n, s.n_sh), "channels": 4 * n * s.n_channels,
            "geometry": 32 * n, "depth_keys": 4 * n, "info": 16 * n, "counts": 16,
            "offsets": 4 * (n + 1), "ranges": 8 * n, "colors": 16 * chunks * n,
            "order": 4 * n, "pair_tiles": 4 * capacity, "pair_gaussians": 4 * capacity,
            "tile_ranges": 8 * s.n_tiles, "entries": 8 * capacity,
            "image": 4 * s.width * s.height * s.n_out, "transmittance": 8 * s.width * s.height,
            **self._sort_sizes(max(n, capacity)),
        }  # fmt: skip
        if s.backward:
            sizes["transmittance"] += 1024 * (capacity // 32 + s.n_tiles)  # T in front of each batch of 32 Gaussians
            sizes |= {
                "gradient": 4 * s.width * s.height * (s.n_out + 1),
                "rows": 16 * (chunks + 2) * capacity, "totals": 16 * (chunks + 2) * n,
                "gradients": 48 * n, "pose": 48 * n if self._with_pose else 4, "sh_gradient": sizes["sh"],
            }  # fmt: skip
        return sizes

    def resize(self, n: int) -> None:
        """Set the number of Gaussians, up to the room of the buffers."""
        self.size = replace(self.size, n=n)

    def _submissions(self, steps: Sequence[Dispatch]) -> Submissions:
        return Submissions(
            self.gpu, steps, self.buffers["dispatches"], constants=self._changing, timings=self._timings,
            work=lambda: (self.size.n, self.size.n_tiles),
        )  # fmt: skip

    def counts(self) -> Counts:
        """Return what the last forward and backward pass counted."""
        return Counts(*(int(value) for value in self.read("counts", (4,), np.uint32)[1:]))

    def set_view(self, camera: PinholeCamera, settings: RasterSettings, sh_degree: int) -> None:
        """Set the camera, the settings and the highest band of the next passes."""
        self.set_camera_values(camera_values(camera, settings), sh_degree)

    def set_camera_values(self, values: NDArray[np.uint32], sh_degree: int) -> None:
        """Set what `camera_values` returns, and the highest band of the next passes."""
        s = self.size
        self._view[:56] = values
        self._view[56:] = (
            s.n, s.width, s.height, -(-s.width // 16), s.n_tiles, sh_degree, s.n_sh, s.n_rgb, 0, s.capacity,
            self._with_pose, s.n,
        )  # fmt: skip
        for uniform in self._uniforms:
            self._write_view(*uniform)

    def _write_view(self, uniform: Uniform, first: int, last: Callable[[], int]) -> None:
        self._view[14 * 4 + 8] = first
        self._view[14 * 4 + 11] = last()
        uniform.write(self._view)

    def _view_uniform(self, first: int, last: Callable[[], int]) -> Uniform:
        uniform = self._uniform(272)
        self._uniforms.append((uniform, first, last))
        self._write_view(*self._uniforms[-1])
        return uniform

    def _over(self, per_group: int, values: int = 1) -> Callable[[], int]:
        """Return the workgroups for `values` values of each Gaussian, `per_group` of them in a workgroup."""
        return lambda: -(-self.size.n * values // per_group)

    def _blocks_of(self, first: int, last: int) -> int:
        """Return the number of blocks of harmonics that the Gaussians from `first` to `last` are in."""
        return -(-max(min(last, self.size.n) - first, 0) // BLOCK)

    def _tiles_step(self, stage: str, kernel: str, names: Sequence[str], first: int, end: int) -> Dispatch:
        """Return the dispatch of a kernel with a workgroup for each tile, for the tiles from `first` to `end`."""
        step = self._step(stage, kernel, self._view_uniform(first, lambda: end), names, end - first)
        part = functools.cache(lambda a, b: self._tiles_step(stage, kernel, names, first + a, first + b))
        return replace(step, part=part)

    def _color_ranges(self) -> list[tuple[int, int, int, int]]:
        """Return the ranges of harmonics that a kernel can see, see `sh_ranges`."""
        return sh_ranges(self.size.n_room, self.size.n_sh, self.gpu.max_binding_bytes)

    def _color_steps(self, stage: str, kernel: str, names: Sequence[str]) -> list[Dispatch]:
        """Return the dispatches of a kernel of harmonics, a workgroup for each block, on all ranges of them."""
        steps = []
        for first, last, at, n_bytes in self._color_ranges():
            parts = [(name, at, n_bytes) if name in ("sh", "sh_gradient") else name for name in names]
            view = self._view_uniform(first, functools.partial(lambda last: min(last, self.size.n), last))
            steps.append(self._step(stage, kernel, view, parts, functools.partial(self._blocks_of, first, last)))
        return steps

    def _forward_steps(self) -> list[Dispatch]:
        project, *lists = self._list_steps()
        return [project, *self._channel_steps(), *lists, self._blend_step()]

    def _list_steps(self) -> list[Dispatch]:
        """Return the projection, and the steps to the lists of Gaussians of each tile, which no channel enters."""
        s = self.size
        view = self._view_uniform(0, lambda: self.size.n)
        steps = [
            self._step(
                "projection", "project", view,
                ["means", "quats", "scales", "opacities", "geometry", "depth_keys", "info", "counts"], self._over(128),
            )
        ]  # fmt: skip
        steps += self._sort("depth sort", 0, "depth_keys", None, 32, "order", lambda: self.size.n)
        gathered = ["info", "order", "offsets"]
        steps.append(self._step("pairs", "gather", view, gathered, lambda: self.size.n // 256 + 1))
        steps += self._scan("pairs", 0, 0, "offsets", lambda: self.size.n + 1)
        steps.append(self._step("pairs", "prepare", view, ["offsets", "counts", "dispatches"], 1))
        steps.append(
            self._step(
                "pairs", "emit", view,
                ["geometry", "info", "order", "offsets", "pair_tiles", "pair_gaussians", "ranges", "counts"],
                self._over(128),
            )
        )  # fmt: skip
        steps += self._sort("tile sort", 1, "pair_tiles", None, s.n_tiles.bit_length(), None, s.capacity)
        steps.append(
            self._step(
                "tile sort", "lists", view, [*self._sorted, "pair_gaussians", "counts", "tile_ranges", "entries"], 1,
                indirect=6,
            )
        )  # fmt: skip
        return steps

    def _channel_steps(self) -> list[Dispatch]:
        """Return the steps that compute what is blended."""
        return self._color_steps("colours", "colors", ["means", "sh", "channels", "colors", "counts"])

    def _blend_step(self) -> Dispatch:
        names = ["geometry", "entries", "tile_ranges", "colors", "image", "transmittance"]
        return self._tiles_step("blending", "blend", names, 0, self.size.n_tiles)

    def _blend_backward_step(self) -> Dispatch:
        names = ["geometry", "entries", "tile_ranges", "colors", "gradient", "transmittance", "rows", "counts"]
        return self._tiles_step("blending backward", "blend_backward", names, 0, self.size.n_tiles)

    def _backward_steps(self) -> list[Dispatch]:
        s = self.size
        view = self._uniforms[0][0]
        chunks = -(-s.n_out // 4)
        names = ["means", "quats", "scales", "opacities", "info", "totals", "gradients", "pose"]
        steps = [
            self._blend_backward_step(),
            self._step("segment sum", "sum_pairs", view, ["ranges", "rows", "totals"], self._over(128, chunks + 2)),
            self._step("projection backward", "project_backward", view, names, self._over(64)),
        ]
        if s.n_sh:
            names = ["means", "sh", "info", "colors", "totals", "sh_gradient", "gradients", "pose"]
            steps += self._color_steps("colours backward", "colors_backward", names)
        return steps

    def forward(self, time: Callable[[str, Any], Any] | None = None) -> None:
        """Queue the forward pass. `time` gives the descriptor of a compute pass for each stage, to measure it."""
        self.start_counts()
        self._submit(self._forward, ["tile_ranges"], time)

    def start_counts(self) -> None:
        """Set what the passes count to its start, before the forward pass."""
        counts = np.array([self.size.n, 0, 0, 0], np.uint32)
        self.gpu.device.queue.write_buffer(self.buffers["counts"], 0, counts)

    def backward(self, time: Callable[[str, Any], Any] | None = None) -> None:
        """Queue the backward pass, from ``gradient`` to the gradients of all inputs."""
        self._submit(self._backward, [], time)

    def _submit(self, run: Submissions, zeroed: Sequence[str], time: Callable[[str, Any], Any] | None = None) -> None:
        """Queue the dispatches of `run` in submissions of bounded time, or with `time` in one."""
        buffers = [self.buffers[name] for name in zeroed]
        if time is None:
            run.run(buffers)
            return
        self._changing.send()
        encoder = self.gpu.device.create_command_encoder()
        for buffer in buffers:
            encoder.clear_buffer(buffer)
        encode(encoder, run.dispatches, self.buffers["dispatches"], time)
        self.gpu.device.queue.submit([encoder.finish()])
