"""A scene for repeated rendering: images as arrays, and the contribution of each Gaussian to sets of pixels."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32
from ..core.errors import EnvironmentProblem
from ..rasterizer.settings import MAX_CHANNELS, Backend, RasterSettings
from ..scene import Gaussians, PinholeCamera

if TYPE_CHECKING:
    import torch

    from ..rasterizer import CachedView, GpuScene, Raster

_Result = TypeVar("_Result")

_CHANNELS_PER_PASS = MAX_CHANNELS - 3
"""Channels rendered in one pass, in addition to the three of a colour. More channels take several passes."""

_SETS_PER_PASS = 16
"""Sets of Gaussians rendered in one pass. Each needs one float per pixel."""

_MAX_CACHE_BYTES = 500_000_000
"""Memory for projected and sorted views. A view of 40,000 Gaussians, 480 pixels wide, takes about 5 MB."""


@dataclass(frozen=True)
class Rendered:
    """Image rendered for a pinhole camera.

    Attributes
    ----------
    channels : array of shape [H, W, C], float32
        Blended colour (3 channels, sRGB) if requested, then the given channels; without a background.
    alpha : array of shape [H, W], float32
        Coverage, 0 to 1.
    """

    channels: Float32
    alpha: Float32


class Scene:
    """Gaussians for repeated rendering without training.

    Parameters
    ----------
    gaussians : Gaussians
        Those of anti-aliased training are rendered anti-aliased.
    backend : {"cpu", "gpu", "reference"}
        Implementation of the rasterizer. With ``gpu`` the Gaussians are copied to the graphics card once.
    on_failure : callable, optional
        Called with the reason when the graphics card fails or is too small. The scene then continues on the processor,
        and `backend` is ``cpu``. Without it, the error is raised.

    Raises
    ------
    EnvironmentProblem
        By the methods, if there is no graphics card, it fails or is too small, and there is no `on_failure`.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        *,
        backend: Backend = "cpu",
        on_failure: Callable[[EnvironmentProblem], None] | None = None,
    ) -> None:
        self.gaussians = gaussians
        self.backend: Backend = backend
        self._settings = RasterSettings(antialiased=gaussians.antialiased)
        self._on_failure = on_failure
        self._card: GpuScene | None = None
        self._means = np.ascontiguousarray(gaussians.means)
        self._quats = np.ascontiguousarray(gaussians.quats)
        self._scales = np.ascontiguousarray(gaussians.scales)
        self._opacities = np.ascontiguousarray(gaussians.opacities)
        self._sh = np.ascontiguousarray(gaussians.sh)
        self._cached_views: OrderedDict[int, tuple[PinholeCamera, CachedView]] = OrderedDict()

    def __len__(self) -> int:
        return len(self.gaussians)

    def with_gaussians(self, gaussians: Gaussians) -> Scene:
        """Return a scene of other Gaussians that is rendered in the same way."""
        return Scene(gaussians, backend=self.backend, on_failure=self._on_failure)

    def render(
        self, camera: PinholeCamera, *, color: bool = False, channels: NDArray[np.floating] | None = None
    ) -> Rendered:
        """Render the scene for a camera.

        Parameters
        ----------
        color : bool
            Render the colour into the first three channels.
        channels : array of shape [N, C], optional
            Further values of each Gaussian to blend.

        Returns
        -------
        Rendered
        """
        if self.backend == "gpu" and len(self):
            given = None if channels is None else np.ascontiguousarray(channels, np.float32)
            on_card = self._on_card(lambda card: card.render(camera, given, color=color))
            if on_card is not None:
                return Rendered(on_card[0], 1.0 - on_card[1])
        if channels is not None and channels.shape[1] > _CHANNELS_PER_PASS:
            blocks = (
                slice(first, first + _CHANNELS_PER_PASS) for first in range(0, channels.shape[1], _CHANNELS_PER_PASS)
            )
            parts = [
                self.render(camera, color=color and block.start == 0, channels=channels[:, block]) for block in blocks
            ]
            return Rendered(np.concatenate([part.channels for part in parts], axis=-1), parts[0].alpha)
        n_channels = 3 * color + (0 if channels is None else channels.shape[1])
        if len(self) == 0:
            empty = np.zeros((camera.height, camera.width, n_channels), np.float32)
            return Rendered(empty, empty[..., 0].copy())
        if channels is not None and not color and self.backend == "cpu":
            image, transmittance = self._cached_view(camera).blend(np.ascontiguousarray(channels, np.float32))
            return Rendered(image, 1.0 - transmittance)
        import torch

        given = None if channels is None else torch.from_numpy(np.ascontiguousarray(channels, np.float32))
        with torch.no_grad():
            raster = self._rasterized(camera, given, color=color)
        return Rendered(raster.image.numpy(), 1.0 - raster.transmittance.numpy())

    def share(self, camera: PinholeCamera, members: NDArray[np.bool_]) -> Float32:
        """Return the share of each pixel, [H, W], that the members, bool [N], contribute in the whole scene."""
        if self.backend == "gpu" and len(self):
            on_card = self._on_card(lambda card: card.share(camera, members))
            if on_card is not None:
                return on_card
        if self.backend == "cpu" and len(self):
            return self._cached_view(camera).share(members)
        return self.render(camera, channels=members.astype(np.float32)[:, None]).channels[..., 0]

    def shares(
        self, camera: PinholeCamera, members: Sequence[NDArray[np.bool_]] | NDArray[np.bool_]
    ) -> Iterator[Float32]:
        """Yield `share` for each of K sets of Gaussians, bool [N] each, of which several are rendered in one pass."""
        for start in range(0, len(members), _SETS_PER_PASS):
            weights = np.stack(list(members[start : start + _SETS_PER_PASS]), axis=1).astype(np.float32)
            shares = self.render(camera, channels=weights).channels
            yield from np.ascontiguousarray(np.moveaxis(shares, -1, 0))

    def depth_of(self, camera: PinholeCamera) -> Float32:
        """Return the depth of each centre along the view axis of `camera`, shape [N], in world units."""
        return (self.gaussians.means @ camera.viewmat[2, :3] + camera.viewmat[2, 3]).astype(np.float32)

    def votes(self, camera: PinholeCamera, weights: NDArray[np.floating]) -> Float32:
        """Return the contribution of each Gaussian to weighted sets of pixels.

        Parameters
        ----------
        weights : array of shape [H, W, C], float
            C sets of pixels, e.g. a mask and its complement.

        Returns
        -------
        array of shape [N, C], float32
            Sum over the pixels p of w_pg * weights[p], with the blending weight w_pg = alpha * transmittance.

        Notes
        -----
        An image C_p = sum_g w_pg c_g is linear in the channels c. The gradient of sum_p weights_p C_p with respect to
        c_g is therefore the vote, and one backward pass of the rasterizer computes the votes of all sets. The
        backend ``cpu`` caches the projected and sorted Gaussians of cameras for further images and votes, ``gpu`` those
        of the last camera.
        """
        if len(self) == 0:
            return np.zeros((0, weights.shape[2]), np.float32)
        if self.backend == "gpu":
            on_card = self._on_card(lambda card: card.votes(camera, np.ascontiguousarray(weights, np.float32)))
            if on_card is not None:
                return on_card
        if weights.shape[2] > _CHANNELS_PER_PASS:
            firsts = range(0, weights.shape[2], _CHANNELS_PER_PASS)
            return np.hstack([self.votes(camera, weights[..., first : first + _CHANNELS_PER_PASS]) for first in firsts])
        if self.backend == "cpu":
            return self._cached_view(camera).votes(np.ascontiguousarray(weights, np.float32))
        import torch

        channels = torch.zeros(len(self), weights.shape[2], requires_grad=True)
        raster = self._rasterized(camera, channels, color=False)
        raster.image.backward(torch.from_numpy(np.ascontiguousarray(weights, np.float32)))
        assert channels.grad is not None
        return channels.grad.numpy()

    def _rasterized(self, camera: PinholeCamera, channels: torch.Tensor | None, *, color: bool) -> Raster:
        """Return what PyTorch's rasterizer makes of the Gaussians and channels, [N, C], on the processor."""
        import torch

        from ..rasterizer import rasterize

        geometry = (self._means, self._quats, self._scales, self._opacities)
        return rasterize(
            *(torch.from_numpy(array) for array in geometry),
            camera=camera,
            sh=torch.from_numpy(self._sh) if color else None,
            channels=channels,
            backend=self.backend,
            settings=self._settings,
        )

    def _on_card(self, compute: Callable[[GpuScene], _Result]) -> _Result | None:
        """Return what `compute` returns for the Gaussians on the graphics card; None if the processor takes over."""
        from ..rasterizer import scene_on_card

        try:
            if self._card is None:
                self._card = scene_on_card(
                    self._means, self._quats, self._scales, self._opacities, self._sh, self._settings
                )
            return compute(self._card)
        except EnvironmentProblem as problem:
            self.leave_card(problem)
            return None

    def leave_card(self, problem: EnvironmentProblem) -> None:
        """Go on on the processor, because of a problem of the card; raises `problem` where the card is demanded."""
        if self.backend != "gpu" or self._on_failure is None:
            raise problem
        self._card, self.backend = None, "cpu"
        self._on_failure(problem)

    def _cached_view(self, camera: PinholeCamera) -> CachedView:
        """Return the projected and sorted Gaussians for `camera`, cached within `_MAX_CACHE_BYTES`."""
        from ..rasterizer import CachedView

        if id(camera) not in self._cached_views:
            view = CachedView(self._means, self._quats, self._scales, self._opacities, camera, self._settings)
            # The camera is kept as well, so that its id is not reused for another object.
            self._cached_views[id(camera)] = (camera, view)
            while (
                len(self._cached_views) > 1
                and sum(cached.n_bytes for _, cached in self._cached_views.values()) > _MAX_CACHE_BYTES
            ):
                self._cached_views.popitem(last=False)
        self._cached_views.move_to_end(id(camera))
        return self._cached_views[id(camera)][1]
