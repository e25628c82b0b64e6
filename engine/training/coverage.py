"""How many training photos see what a picture shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from numpy.typing import NDArray

from ..core.system import usable_cores
from ..rasterizer import GpuScene, scene_on_card
from ..rasterizer.settings import Backend, RasterSettings
from ..scene import PinholeCamera
from .parameters import render

WELL_SEEN = 3
"""Number of training photos from which a place counts as well seen: two determine its depth, a third confirms it."""

SIDE = 160
"""Longest side of the depth maps of the training photos, pixels."""

COUNTED_SIDE = 320
"""Longest side of the pictures in which photos are counted, pixels; larger ones get the counts of the nearest pixel."""

MIN_COVER = 0.5
"""Least coverage of a pixel whose depth counts; what is more transparent has no surface."""

DEPTH_TOLERANCE = 0.1
"""How much deeper than the surface that a photo shows a place may lie and still be seen by it, as a fraction."""


class Coverage:
    """The surfaces that training photos see.

    Parameters
    ----------
    values : dict of str to tensor
        Trained Gaussians, as in `Parameters.values`.
    cameras : sequence of PinholeCamera
        Of the training photos.
    backend : {"cpu", "gpu", "reference"}
    """

    def __init__(
        self, values: dict[str, torch.Tensor], cameras: Sequence[PinholeCamera], *, backend: Backend = "cpu"
    ) -> None:
        self._values, self._backend = values, backend
        # They end with this object, and are shared by the threads that count.
        self._threads = ThreadPoolExecutor(len(usable_cores()))
        self._card = _scene_on_card(values) if backend == "gpu" and len(values["means"]) else None
        self._seen = [(camera, self._depth(camera)) for camera in (one.reduced(SIDE) for one in cameras)]

    def counts(self, camera: PinholeCamera) -> NDArray[np.int32]:
        """Return how many training photos see what each pixel of a camera shows, shape [height, width].

        A photo sees a place that lies in its picture and not behind what it shows there. Pixels without a surface
        count 0.
        """
        return self.counting(camera)()

    def counting(self, camera: PinholeCamera) -> Callable[[], NDArray[np.int32]]:
        """Render what a camera shows, and return what counts it as `counts` does, which any thread may call."""
        width, height = camera.width, camera.height
        camera = camera.reduced(COUNTED_SIDE)
        depth = self._depth(camera)

        def count() -> NDArray[np.int32]:
            rows, columns = np.nonzero(np.isfinite(depth))
            counts = np.zeros(depth.shape, np.int32)
            counts[rows, columns] = self.of_places(camera.places(rows, columns, depth[rows, columns]))
            nearest_row = (np.arange(height) + 0.5) * camera.height / height
            nearest_column = (np.arange(width) + 0.5) * camera.width / width
            return counts[nearest_row.astype(int)[:, None], nearest_column.astype(int)]

        return count

    def of_places(self, places: NDArray[np.floating]) -> NDArray[np.int32]:
        """Return how many training photos see each of `places`, [P, 3], shape [P]."""
        counts, wide = np.zeros(len(places), np.int32), places.astype(np.float64)
        for seen in self._threads.map(lambda one: _sees(one[0], one[1], wide), self._seen):
            counts += seen
        return counts

    def _depth(self, camera: PinholeCamera) -> NDArray[np.float64]:
        """Return the depth along the view axis of what each pixel shows, infinite without a surface.

        It is the harmonic mean of the blended depths: what shines through from far behind hardly changes it.
        """
        with torch.no_grad():
            viewmat = torch.from_numpy(camera.viewmat).float()
            depths = self._values["means"] @ viewmat[2, :3] + viewmat[2, 3]
            inverse = (1.0 / depths.clamp_min(RasterSettings().near))[:, None]
            if self._card is not None:
                image, transmittance = self._card.render(camera, inverse.numpy())
            else:
                raster = render(self._values, camera, backend=self._backend, sh_degree=None, channels=inverse)
                image, transmittance = raster.image.numpy(), raster.transmittance.numpy()
        cover = 1.0 - transmittance.astype(np.float64)
        blended = image[..., 0].astype(np.float64)
        return np.where(cover >= MIN_COVER, cover / np.maximum(blended, 1e-12), np.inf)


def _scene_on_card(values: dict[str, torch.Tensor]) -> GpuScene:
    """Return the Gaussians on the card, where they stay for the depth maps of all cameras."""
    with torch.no_grad():
        scales, opacities = values["log_scales"].exp(), values["opacity_logits"].sigmoid()
    means, quats, colors = (values[name].detach().numpy() for name in ("means", "quats", "sh_dc"))
    return scene_on_card(means, quats, scales.detach().numpy(), opacities.detach().numpy(), colors)


def _sees(camera: PinholeCamera, surface: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which places, [P, 3], a camera sees whose surface has these depths."""
    rows, pixels, depths = camera.project(places)
    column, row = pixels.astype(int).T
    seen = np.zeros(len(places), bool)
    seen[rows] = depths <= surface[row, column] * (1.0 + DEPTH_TOLERANCE)
    return seen
