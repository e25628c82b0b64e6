"""A camera's view of Gaussians that stay as they are: projected and sorted once, then blended as often as is wanted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from ..scene import PinholeCamera
from .api import MAX_CHANNELS, check_camera, check_finite
from .blend_backward import MOMENTS
from .cpu import View, blend_view, padded, pair_gradients, project_view
from .settings import RasterSettings
from .tile_spans import TILE

__all__ = ["StillView"]

Float32 = NDArray[np.float32]


class StillView:
    """What `camera` sees of N Gaussians, for any number of channels that come later.

    Parameters
    ----------
    means, quats, scales, opacities : float32 arrays
        As in `engine.rasterizer.api.rasterize`.
    camera : PinholeCamera

    Raises
    ------
    NumericalError
        When an array is not finite; later for channels and weights too.
    CameraError
        When the camera has skew, an empty picture or values that are not finite.

    Notes
    -----
    The same bits as from `rasterize` with the ``cpu`` backend. Projecting and sorting is a third of a picture of few
    channels, and blending it another third of a count of votes, which `rasterize` has to do each time.
    """

    def __init__(
        self, means: Float32, quats: Float32, scales: Float32, opacities: Float32, camera: PinholeCamera
    ) -> None:
        n = len(means)
        check_camera(camera)
        self._view = View(camera, 0, RasterSettings())
        nothing = np.zeros((n, 0), np.float32)
        project_view(self._view, means, quats, scales, opacities, nothing.reshape(n, 0, 3), nothing)

    @property
    def n_bytes(self) -> int:
        """Memory held."""
        view = self._view
        assert view.projected is not None and view.lists is not None
        held = [*vars(view.projected).values(), *vars(view.lists).values()]
        return sum(array.nbytes for array in held) + 2 * len(view.lists.gaussians)

    def blend(self, channels: Float32) -> tuple[Float32, Float32]:
        """Return the picture [H, W, C] of `channels`, float32 [N, C <= 64], and the transmittance [H, W]."""
        check_finite("channels", torch.from_numpy(channels))
        return self._blend(channels)

    def share(self, members: NDArray[np.bool_]) -> Float32:
        """Return the share of each pixel, [H, W], that the members, bool [N], make up; what it costs is where they are."""
        lists = self._view.lists
        assert lists is not None
        chosen = members.astype(np.float32)[:, None]
        if self._view.masks is None:
            return self.blend(chosen)[0][..., 0]
        before = np.concatenate([[0], np.cumsum(members[lists.gaussians])])[lists.tile_start]
        return self._blend(chosen, np.flatnonzero(np.diff(before)).astype(np.int32))[0][..., 0]

    def votes(self, weights: Float32) -> Float32:
        """Return how much of each weighted set of pixels, float32 [H, W, C <= 64], every Gaussian makes up: [N, C]."""
        lists = self._view.lists
        assert lists is not None
        pair_start, n_channels = lists.pair_start, weights.shape[2]
        tiles = _tiles_with(weights != 0)
        self._take(np.zeros((len(pair_start) - 1, 1), np.float32))
        blend_view(self._view, 1, None if self._view.masks is None else tiles)
        self._take(np.zeros((len(pair_start) - 1, n_channels), np.float32))
        pairs = pair_gradients(self._view, weights, np.zeros(0, np.float32), tiles)
        self._view.geometry = None
        votes = np.zeros((len(pair_start) - 1, n_channels), np.float32)
        filled = np.zeros(len(pairs), bool)
        for t in tiles:
            filled[lists.tile_start[t] : lists.tile_start[t + 1]] = True
        rows = lists.places[filled[lists.places]]  # of one Gaussian after another, in the order of its pairs
        if len(rows):
            owner = lists.gaussians[rows]
            first = np.flatnonzero(np.diff(owner, prepend=-1))
            mine = pairs[rows, MOMENTS : MOMENTS + n_channels]
            votes[owner[first]] = np.add.reduceat(mine, first, axis=0, dtype=np.float64)
        return votes

    def _blend(self, channels: Float32, tiles: NDArray[np.int32] | None = None) -> tuple[Float32, Float32]:
        self._take(channels)
        blended = blend_view(self._view, channels.shape[1], tiles)
        self._view.geometry = None  # as much memory as all else, and many views are kept
        return blended

    def _take(self, channels: Float32) -> None:
        assert self._view.projected is not None
        n, n_channels = channels.shape
        if n_channels > MAX_CHANNELS:
            raise ValueError(f"at most {MAX_CHANNELS} channels in a picture, got {n_channels}")
        colors = np.zeros((n, padded(n_channels)), np.float32)
        colors[:, :n_channels] = channels
        self._view.projected = replace(self._view.projected, colors=colors)


def _tiles_with(pixels: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the tiles in which any of `pixels` [H, W, C] is true."""
    height, width = pixels.shape[:2]
    padded_pixels = np.zeros((-(-height // TILE) * TILE, -(-width // TILE) * TILE), bool)
    padded_pixels[:height, :width] = pixels.any(axis=2)
    by_tile = padded_pixels.reshape(padded_pixels.shape[0] // TILE, TILE, -1, TILE)
    return np.flatnonzero(by_tile.any(axis=(1, 3))).astype(np.int32)
