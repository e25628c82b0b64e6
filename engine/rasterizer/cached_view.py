"""`CachedView`: Gaussians that are projected and sorted once for a camera, and then blended with different channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..core.arrays import Float32
from ..scene import PinholeCamera
from .blend_backward import MOMENTS_SIZE
from .cpu import View, blend_view, padded_channels, pair_gradients, project_view
from .raster import check_camera, check_finite
from .settings import MAX_CHANNELS, RasterSettings
from .tile_spans import TILE


class CachedView:
    """The projection of N Gaussians to a camera, which renders any channels without projecting and sorting again.

    Parameters
    ----------
    means, quats, scales, opacities : float32 arrays of shape [N, 3], [N, 4], [N, 3], [N]
        As in `engine.rasterizer.rasterize`. They must not change afterwards.

    Raises
    ------
    NumericalError
        If an array is not finite. The methods raise it for channels and weights.
    CameraError
        If the camera has skew, an empty image or values that are not finite.

    Notes
    -----
    Images have the same bits as those of `rasterize` with the ``cpu`` backend. Projecting and sorting take a third of
    the time of an image with few channels, and blending takes another third of the time of counting votes.
    """

    def __init__(
        self,
        means: Float32,
        quats: Float32,
        scales: Float32,
        opacities: Float32,
        camera: PinholeCamera,
        settings: RasterSettings | None = None,
    ) -> None:
        n = len(means)
        check_camera(camera)
        self._view = View(camera, 0, settings or RasterSettings())
        nothing = np.zeros((n, 0), np.float32)
        project_view(self._view, means, quats, scales, opacities, nothing.reshape(n, 0, 3), nothing)

    @property
    def n_bytes(self) -> int:
        """Memory of the cached arrays in bytes."""
        view = self._view
        assert view.projected is not None and view.lists is not None
        arrays = [*vars(view.projected).values(), *vars(view.lists).values()]
        return sum(array.nbytes for array in arrays) + 2 * len(view.lists.gaussians)

    def blend(self, channels: Float32) -> tuple[Float32, Float32]:
        """Render channels.

        Parameters
        ----------
        channels : float32 array of shape [N, C], C at most 64

        Returns
        -------
        image : float32 array of shape [H, W, C]
        transmittance : float32 array of shape [H, W]
        """
        check_finite("channels", torch.from_numpy(channels))
        return self._blend(channels)

    def share(self, members: NDArray[np.bool_]) -> Float32:
        """Return the blending weight of the `members`, bool [N], at each pixel: float32 [H, W] in [0, 1].

        After the first image, only tiles that contain members are blended.
        """
        lists = self._view.lists
        assert lists is not None
        selected = members.astype(np.float32)[:, None]
        if self._view.masks is None:
            return self.blend(selected)[0][..., 0]
        n_before = np.concatenate([[0], np.cumsum(members[lists.gaussians])])[lists.tile_start]
        return self._blend(selected, np.flatnonzero(np.diff(n_before)).astype(np.int32))[0][..., 0]

    def votes(self, weights: Float32) -> Float32:
        """Return the sum of each Gaussian's blending weights, multiplied by `weights`, over all pixels.

        Parameters
        ----------
        weights : float32 array of shape [H, W, C], C at most 64
            Weights of the pixels, such as C masks.

        Returns
        -------
        float32 array of shape [N, C]
            Equal to the gradient of ``(image * weights).sum()`` with respect to the channels.
        """
        lists = self._view.lists
        assert lists is not None
        pair_start, n_channels = lists.pair_start, weights.shape[2]
        tiles = _tiles_with(weights != 0)
        self._set_channels(np.zeros((len(pair_start) - 1, 1), np.float32))
        blend_view(self._view, 1, None if self._view.masks is None else tiles)
        self._set_channels(np.zeros((len(pair_start) - 1, n_channels), np.float32))
        pairs = pair_gradients(self._view, weights, np.zeros(0, np.float32), tiles)
        self._view.geometry = None
        votes = np.zeros((len(pair_start) - 1, n_channels), np.float32)
        filled = np.zeros(len(pairs), bool)
        for t in tiles:
            filled[lists.tile_start[t] : lists.tile_start[t + 1]] = True
        # Rows of one Gaussian after another, each in the order of its pairs.
        rows = lists.list_positions[filled[lists.list_positions]]
        if len(rows):
            owners = lists.gaussians[rows]
            first = np.flatnonzero(np.diff(owners, prepend=-1))
            pair_votes = pairs[rows, MOMENTS_SIZE : MOMENTS_SIZE + n_channels].astype(np.float64)
            # A product with a sparse matrix of ones adds in the same order as `np.add.reduceat`, four times as fast.
            each = np.arange(len(rows)), np.append(first, len(rows))
            votes[owners[first]] = csr_matrix((np.ones(len(rows)), *each), shape=(len(first), len(rows))) @ pair_votes
        return votes

    def _blend(self, channels: Float32, tiles: NDArray[np.int32] | None = None) -> tuple[Float32, Float32]:
        """Return image and transmittance of `channels`, zero outside of `tiles`."""
        self._set_channels(channels)
        blended = blend_view(self._view, channels.shape[1], tiles)
        self._view.geometry = None  # It takes as much memory as all other arrays, and callers keep many views.
        return blended

    def _set_channels(self, channels: Float32) -> None:
        """Replace the values to blend."""
        assert self._view.projected is not None
        n, n_channels = channels.shape
        if n_channels > MAX_CHANNELS:
            raise ValueError(f"an image has at most {MAX_CHANNELS} channels, got {n_channels}")
        colors = np.zeros((n, padded_channels(n_channels)), np.float32)
        colors[:, :n_channels] = channels
        self._view.projected = replace(self._view.projected, colors=colors)


def _tiles_with(pixels: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the numbers of the tiles in which any of `pixels` [H, W, C] is true."""
    height, width = pixels.shape[:2]
    padded_pixels = np.zeros((-(-height // TILE) * TILE, -(-width // TILE) * TILE), bool)
    padded_pixels[:height, :width] = pixels.any(axis=2)
    by_tile = padded_pixels.reshape(padded_pixels.shape[0] // TILE, TILE, -1, TILE)
    return np.flatnonzero(by_tile.any(axis=(1, 3))).astype(np.int32)
