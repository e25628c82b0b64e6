"""Gaussians of one scene that stay on a card, for pictures and votes from many cameras.

A picture takes its lists, the projected Gaussians and the sorted pairs of a tile and a Gaussian, from the last camera if
that is the same one. Votes are the gradient of an image that is linear in its channels: only blending runs backward, and
only what belongs to channels is summed and read.
"""

from __future__ import annotations

import weakref
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...core.arrays import Float32
from ...scene import PinholeCamera
from ..raster import check_camera, check_finite
from ..settings import RasterSettings
from .adapters import Gpu, translate_card_errors
from .frame import Frame
from .layout import FrameSize, grown_capacity, pack_sh, sh_bytes
from .submissions import Dispatch, Timings
from .workspace import Workspace

CHANNELS_PER_PASS = 16
"""Channels blended or voted for in one pass, beside colours. It bounds the memory of votes, 96 bytes a pair, and the number
of kernels: a pass has this many channels or half, a quarter and so on."""

MAX_SIZES = 4
"""Sizes of pictures whose dispatches are kept."""

_ADVICE = "use the CPU"
_GEOMETRY = ("means", "quats", "scales", "opacities")
_LISTED = ("geometry", "entries", "tile_ranges", "ranges", "counts")
"""What pictures take from the lists of a camera."""
_NOT_FINITE = 12
"""Byte of the flags in ``counts``."""

_Frames = OrderedDict[tuple[int, int], dict[tuple[type[Frame], int, int], Frame]]


class _Lists(Frame):
    """The projected Gaussians of a camera, and the list of each tile."""

    def _sizes(self) -> dict[str, int]:
        unused = ("sh", "channels", "colors", "image", "transmittance")
        return {name: n_bytes for name, n_bytes in super()._sizes().items() if name not in unused}

    def _forward_steps(self) -> list[Dispatch]:
        return self._list_steps()


class _Picture(Frame):
    """A picture of channels by the lists that are in its buffers."""

    _own: tuple[str, ...] = ("means", "sh", "channels", "colors", "image", "transmittance")

    def _sizes(self) -> dict[str, int]:
        sizes = super()._sizes()
        return {name: sizes[name] for name in (*_LISTED, *self._own)}

    def _forward_steps(self) -> list[Dispatch]:
        return [*self._channel_steps(), self._blend_step()]

    def run(self, camera: PinholeCamera, sh_degree: int) -> int:
        """Queue the passes, and return the flags of what was not finite."""
        self.set_view(camera, RasterSettings(), sh_degree)
        self.gpu.device.queue.write_buffer(self.buffers["counts"], _NOT_FINITE, np.zeros(1, np.uint32))
        self._submit(self._forward, [])
        return self.counts().not_finite


class _Votes(_Picture):
    """Votes of the weights in ``gradient``, in the buffer ``votes`` [N, C], by the lists that are in its buffers."""

    _own = ("colors", "image", "transmittance", "gradient", "rows")

    def _sizes(self) -> dict[str, int]:
        return super()._sizes() | {"votes": 4 * self.size.n_room * self.size.n_out}

    def _forward_steps(self) -> list[Dispatch]:
        # The weights of blending do not depend on the colours, which may be anything.
        view = self._view_uniform(0, lambda: self.size.n)
        n_groups = self._over(128, -(-self.size.n_out // 4))
        add = self._step("segment sum", "sum_votes", view, ["ranges", "rows", "votes"], n_groups)
        return [self._blend_step(), self._blend_backward_step(), add]

    def _backward_steps(self) -> list[Dispatch]:
        return []


class GpuScene:
    """Pictures and votes of N Gaussians, at least one, on a card.

    Parameters
    ----------
    means, quats, scales, opacities : float32 arrays of shape [N, 3], [N, 4], [N, 3], [N]
        As in `engine.rasterizer.rasterize`. They and `sh` must not change afterwards.
    sh : float32 array of shape [N, n_sh, 3]

    Raises
    ------
    EnvironmentProblem
        If something needs larger buffers than the card has, or the card stops working. The methods raise it too.
    """

    def __init__(
        self,
        gpu: Gpu,
        means: Float32,
        quats: Float32,
        scales: Float32,
        opacities: Float32,
        sh: Float32,
        settings: RasterSettings | None = None,
    ) -> None:
        self._gpu = gpu
        self._settings = settings or RasterSettings()
        self._arrays = dict(zip(_GEOMETRY, (means, quats, scales, opacities), strict=True))
        self._sh, self._n = sh, len(means)
        self._capacity = max(4096, 4 * self._n)
        self._pool: dict[str, Any] = {}
        self._timings = Timings(gpu)
        self._frames: _Frames = OrderedDict()
        self._camera: PinholeCamera | None = None
        # Frames and their dispatches refer to each other: without this, their memory waits for the collector.
        weakref.finalize(self, _release, self._frames).atexit = False
        self._values = Workspace(gpu, f"this scene of {self._n:,} Gaussians")
        self._values.allocate({name: array.nbytes for name, array in self._arrays.items()})
        with translate_card_errors(gpu, _ADVICE):
            for name, array in self._arrays.items():
                self._values.write(name, array)

    def render(
        self, camera: PinholeCamera, channels: Float32 | None = None, *, color: bool = False
    ) -> tuple[Float32, Float32]:
        """Render colours, channels or both.

        Parameters
        ----------
        channels : float32 array of shape [N, C], optional
            Any number of channels.
        color : bool
            Whether the first three values of a pixel are colours.

        Returns
        -------
        image : float32 array of shape [H, W, 3 + C] or [H, W, C]
        transmittance : float32 array of shape [H, W]

        Raises
        ------
        NumericalError
            If an input is not finite, or 2^31 pairs of a tile and a Gaussian or more are needed.
        CameraError
            If the camera has skew, an empty image or values that are not finite.
        ValueError
            If there is nothing to render.
        """
        given = np.zeros((self._n, 0), np.float32) if channels is None else channels
        if not color and given.shape[1] == 0:
            raise ValueError("an image has at least one channel")
        with translate_card_errors(self._gpu, _ADVICE):
            self._list(camera)
            parts = []
            for first in range(0, max(given.shape[1], 1), CHANNELS_PER_PASS):
                part = given[:, first : first + CHANNELS_PER_PASS]
                frame = self._blend(camera, part, color=color and first == 0)
                s = frame.size
                image = frame.read("image", (s.height, s.width, s.n_out))
                parts.append(image[..., : s.n_rgb + part.shape[1]])
            image = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=2)
            return np.ascontiguousarray(image), frame.read("transmittance", (s.height, s.width))

    def share(self, camera: PinholeCamera, members: NDArray[np.bool_]) -> Float32:
        """Return the blending weight of the `members`, bool [N], at each pixel: float32 [H, W] in [0, 1]."""
        with translate_card_errors(self._gpu, _ADVICE):
            self._list(camera)
            frame = self._blend(camera, members.astype(np.float32)[:, None], color=False)
            return frame.read("image", (camera.height, camera.width))

    def votes(self, camera: PinholeCamera, weights: Float32) -> Float32:
        """Return the sum of each Gaussian's blending weights, multiplied by `weights`, over all pixels.

        Parameters
        ----------
        weights : float32 array of shape [H, W, C]
            Any number of sets of pixels, such as masks.

        Returns
        -------
        float32 array of shape [N, C]

        Raises
        ------
        NumericalError, CameraError
            As `render`.
        """
        found = np.zeros((self._n, weights.shape[2]), np.float32)
        with translate_card_errors(self._gpu, _ADVICE):
            self._list(camera)
            for first in range(0, weights.shape[2], CHANNELS_PER_PASS):
                part = weights[..., first : first + CHANNELS_PER_PASS]
                frame = self._frame(_Votes, camera, 0, part.shape[2])
                # The last value is the weight of the transmittance.
                gradient = np.zeros((camera.height, camera.width, frame.size.n_out + 1), np.float32)
                gradient[..., : part.shape[2]] = part
                frame.write("gradient", gradient)
                if frame.run(camera, 0):
                    check_finite("weights", torch.from_numpy(np.ascontiguousarray(part)))
                votes = frame.read("votes", (self._n, frame.size.n_out))
                found[:, first : first + part.shape[2]] = votes[:, : part.shape[2]]
        return found

    def _list(self, camera: PinholeCamera) -> None:
        """Project and sort for a camera, unless the last one is the same, and grow the buffers until all pairs fit."""
        if self._camera is camera:
            return
        check_camera(camera)
        self._camera = None
        while True:
            lists = self._lists_of(camera)
            lists.set_view(camera, self._settings, 0)
            lists.forward()
            counts = lists.counts()
            if counts.not_finite:
                for name, array in self._arrays.items():
                    check_finite(name, torch.from_numpy(array))
            if counts.n_wanted <= self._capacity:
                self._camera = camera
                return
            self._capacity = grown_capacity(counts.n_wanted, self._n)
            _release(self._frames)

    def _blend(self, camera: PinholeCamera, channels: Float32, *, color: bool) -> _Picture:
        """Return a picture of at most `CHANNELS_PER_PASS` channels [N, C], and of the colours in front of them."""
        n_sh = self._sh.shape[1] if color else 0
        if color and "sh" not in self._values.buffers:
            self._values.allocate({"sh": sh_bytes(self._n, n_sh)})
            self._values.write("sh", pack_sh(self._sh))
        frame = self._frame(_Picture, camera, n_sh, channels.shape[1])
        padded = np.zeros((self._n, frame.size.n_channels), np.float32)
        padded[:, : channels.shape[1]] = channels
        frame.write("channels", padded)
        if frame.run(camera, round(n_sh**0.5) - 1 if color else 0):
            check_finite("channels", torch.from_numpy(padded))
            check_finite("sh", torch.from_numpy(self._sh))
        return frame

    def _lists_of(self, camera: PinholeCamera) -> Frame:
        """Return the lists of pictures of this size; the pictures used longest ago are freed."""
        size = camera.width, camera.height
        if size not in self._frames:
            frame_size = FrameSize(self._n, 0, 4, *size, self._capacity, backward=False)
            lists = _Lists(self._gpu, frame_size, shared=self._values.buffers, pool=self._pool, timings=self._timings)
            self._frames[size] = {(_Lists, 0, 0): lists}
        self._frames.move_to_end(size)
        while len(self._frames) > MAX_SIZES:
            for frame in self._frames.popitem(last=False)[1].values():
                frame.release()
        return self._frames[size][_Lists, 0, 0]

    def _frame(self, kind: type[_Picture], camera: PinholeCamera, n_sh: int, n_channels: int) -> _Picture:
        """Return the buffers and dispatches of pictures or votes with at least so many channels."""
        frames = self._frames[camera.width, camera.height]
        room = 1 << (n_channels - 1).bit_length() if n_channels else 0
        if (kind, n_sh, room) not in frames:
            size = FrameSize(
                self._n, n_sh, room, camera.width, camera.height, self._capacity, backward=issubclass(kind, _Votes)
            )
            lists = frames[_Lists, 0, 0].buffers
            shared: Mapping[str, Any] = self._values.buffers | {name: lists[name] for name in _LISTED}
            frames[kind, n_sh, room] = kind(
                self._gpu, size, n_moving=0, shared=shared, pool=self._pool, timings=self._timings
            )
        found = frames[kind, n_sh, room]
        assert isinstance(found, _Picture)
        return found


def _release(frames: _Frames) -> None:
    for by_kind in frames.values():
        for frame in by_kind.values():
            frame.release()
    frames.clear()
