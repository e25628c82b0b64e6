"""A scene that is looked at often: rendered into arrays, and asked which Gaussians a set of pixels shows."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from ..rasterizer import MAX_CHANNELS, rasterize
from ..scene import Gaussians, PinholeCamera

if TYPE_CHECKING:
    from ..rasterizer import StillView

__all__ = ["Backend", "Rendered", "Scene", "normalized"]

Backend = Literal["cpu", "reference"]
Float32 = NDArray[np.float32]

_AT_ONCE = MAX_CHANNELS - 3
"""Channels that are rendered in one go, with room for a colour; more take several."""

_KEPT_BYTES = 500_000_000
"""Of projected and sorted views: about 5 MB each with 40,000 Gaussians in pictures 480 pixels wide."""


@dataclass(frozen=True)
class Rendered:
    """What a pinhole camera sees.

    Attributes
    ----------
    channels : array of shape [H, W, C], float32
        Blended colour (sRGB, 3 channels, when asked for) and then the channels that were given; no background.
    alpha : array of shape [H, W], float32
        How much is covered, 0 to 1.
    """

    channels: Float32
    alpha: Float32


def normalized(vectors: NDArray[np.floating]) -> Float32:
    """Return `vectors` [..., D] at unit length; those of no length stay zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors, dtype=np.float32), where=lengths > 1e-12)


class Scene:
    """Gaussians ready to be rendered many times without training.

    Parameters
    ----------
    gaussians : Gaussians
    backend : {"cpu", "reference"}
        Implementation of the rasterizer.
    """

    def __init__(self, gaussians: Gaussians, *, backend: Backend = "cpu") -> None:
        self.gaussians = gaussians
        self.backend: Backend = backend
        self._means = torch.from_numpy(np.ascontiguousarray(gaussians.means))
        self._quats = torch.from_numpy(np.ascontiguousarray(gaussians.quats))
        self._scales = torch.from_numpy(np.ascontiguousarray(gaussians.scales))
        self._opacities = torch.from_numpy(np.ascontiguousarray(gaussians.opacities))
        self._sh = torch.from_numpy(np.ascontiguousarray(gaussians.sh))
        self._still: OrderedDict[int, tuple[PinholeCamera, StillView]] = OrderedDict()

    def __len__(self) -> int:
        return len(self.gaussians)

    def render(
        self, camera: PinholeCamera, *, color: bool = False, channels: NDArray[np.floating] | None = None
    ) -> Rendered:
        """Return what `camera` sees.

        Parameters
        ----------
        camera : PinholeCamera
        color : bool
            Blend the spherical harmonics into the first three channels.
        channels : array of shape [N, C], optional
            Further values to blend.

        Returns
        -------
        Rendered
        """
        if channels is not None and channels.shape[1] > _AT_ONCE:
            blocks = (slice(first, first + _AT_ONCE) for first in range(0, channels.shape[1], _AT_ONCE))
            parts = [
                self.render(camera, color=color and block.start == 0, channels=channels[:, block]) for block in blocks
            ]
            return Rendered(np.concatenate([part.channels for part in parts], axis=-1), parts[0].alpha)
        n_channels = 3 * color + (0 if channels is None else channels.shape[1])
        if len(self) == 0:
            empty = np.zeros((camera.height, camera.width, n_channels), np.float32)
            return Rendered(empty, empty[..., 0].copy())
        if channels is not None and not color and self.backend == "cpu":
            image, transmittance = self._still_view(camera).blend(np.ascontiguousarray(channels, np.float32))
            return Rendered(image, 1.0 - transmittance)
        with torch.no_grad():
            raster = rasterize(
                self._means,
                self._quats,
                self._scales,
                self._opacities,
                camera=camera,
                sh=self._sh if color else None,
                channels=None if channels is None else torch.from_numpy(np.ascontiguousarray(channels, np.float32)),
                backend=self.backend,
            )
        return Rendered(raster.image.numpy(), 1.0 - raster.transmittance.numpy())

    def share(self, camera: PinholeCamera, members: NDArray[np.bool_]) -> Float32:
        """Return the share of each pixel, [H, W], that the members, bool [N], make up, occluded by the others."""
        if self.backend == "cpu" and len(self):
            return self._still_view(camera).share(members)
        return self.render(camera, channels=members.astype(np.float32)[:, None]).channels[..., 0]

    def depth_of(self, camera: PinholeCamera) -> Float32:
        """Return the depth of every centre along the view axis of `camera`, shape [N], world units."""
        return (self.gaussians.means @ camera.viewmat[2, :3] + camera.viewmat[2, 3]).astype(np.float32)

    def votes(self, camera: PinholeCamera, weights: NDArray[np.floating]) -> Float32:
        """Return how much of each weighted set of pixels every Gaussian makes up.

        Parameters
        ----------
        camera : PinholeCamera
        weights : array of shape [H, W, C], float
            C sets of pixels, e.g. a mask and its complement.

        Returns
        -------
        array of shape [N, C], float32
            sum over pixels p of w_pg * weights[p], w_pg the blending weight alpha * transmittance.

        Notes
        -----
        A picture C_p = sum_g w_pg c_g is linear in the channels c, so the gradient of sum_p weights_p C_p with
        respect to c_g is exactly the vote; one backward pass of the rasterizer counts all sets at once.
        The ``cpu`` backend keeps a camera's projected and sorted Gaussians for the next picture and the next votes.
        """
        if len(self) == 0:
            return np.zeros((0, weights.shape[2]), np.float32)
        if weights.shape[2] > _AT_ONCE:
            firsts = range(0, weights.shape[2], _AT_ONCE)
            return np.hstack([self.votes(camera, weights[..., first : first + _AT_ONCE]) for first in firsts])
        if self.backend == "cpu":
            return self._still_view(camera).votes(np.ascontiguousarray(weights, np.float32))
        channels = torch.zeros(len(self), weights.shape[2], requires_grad=True)
        raster = rasterize(
            self._means,
            self._quats,
            self._scales,
            self._opacities,
            camera=camera,
            channels=channels,
            backend=self.backend,
        )
        raster.image.backward(torch.from_numpy(np.ascontiguousarray(weights, np.float32)))
        assert channels.grad is not None
        return channels.grad.numpy()

    def _still_view(self, camera: PinholeCamera) -> StillView:
        """Return what does not change from one picture of `camera` to the next, made once while there is room."""
        from ..rasterizer import StillView

        if id(camera) not in self._still:
            view = StillView(
                self._means.numpy(), self._quats.numpy(), self._scales.numpy(), self._opacities.numpy(), camera
            )
            # The camera is kept too: its id must not become that of another.
            self._still[id(camera)] = (camera, view)
            while len(self._still) > 1 and sum(kept.n_bytes for _, kept in self._still.values()) > _KEPT_BYTES:
                self._still.popitem(last=False)
        self._still.move_to_end(id(camera))
        return self._still[id(camera)][1]
