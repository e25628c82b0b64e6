"""Photos as the detector and SAM get them, with a bounded cache of pixels and of SAM's embeddings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.arrays import Mask, Pixels
from ..core.errors import PhotoError
from ..scene import Camera
from .prompts import Place
from .settings import SegmentSettings

if TYPE_CHECKING:
    from ..masks import Embedding, EmbeddingFolder, SegmentAnything
    from .views import View

SamFactory = Callable[[], "SegmentAnything"]


class Photos:
    """Photos of a folder, reduced for the models. Each is read, and encoded by SAM, once as long as the cache holds it.

    Parameters
    ----------
    settings : SegmentSettings
        Of them, `photo_side`, the longer side in pixels, and `n_vote_views`, the photos that the cache has place for: 3
        MB of pixels each, and 4 MB of SAM's embeddings.
    sam_factory : callable
        Called when SAM is first needed.
    embeddings : EmbeddingFolder or None
        Caches on disk what SAM encodes.
    """

    def __init__(
        self,
        folder: Path,
        settings: SegmentSettings,
        sam_factory: SamFactory,
        embeddings: EmbeddingFolder | None = None,
    ) -> None:
        self._folder, self._side = folder, settings.photo_side
        self._sam_factory, self._on_disk = sam_factory, embeddings
        cached = lru_cache(settings.n_vote_views)
        self._pixels, self._embedding = cached(self._load), cached(self._encode)

    @cached_property
    def _sam(self) -> SegmentAnything:
        return self._sam_factory()

    def _load(self, name: str) -> Pixels:
        from ..photos import load_pixels  # accepting a picture reads no photo

        pixels = load_pixels(self._folder / name, max_side=self._side)
        pixels.setflags(write=False)
        return pixels

    def _encode(self, name: str) -> Embedding:
        pixels, on_disk = self._pixels(name), self._on_disk
        return self._sam.encode(pixels) if on_disk is None else on_disk.encode(name, pixels, self._sam)

    def pixels(self, camera: Camera) -> Pixels:
        """Return the photo, uint8 [H, W, 3], read-only."""
        return self._pixels(camera.photo)

    def picture(self, view: View) -> Pixels:
        """Return the photo of a view to be looked at, uint8 [H, W, 3]; the scene as seen there if it cannot be read."""
        try:
            return self.pixels(view.camera)
        except PhotoError:
            from ..pictures import render_view  # accepting a picture renders nothing

            picture: Pixels = render_view(view.scene.gaussians, view.camera, backend=view.scene.backend)
            return picture

    def scale(self, camera: Camera) -> float:
        """Return the size of `pixels` relative to the photo at full size."""
        return self.pixels(camera).shape[1] / camera.width

    def segment(
        self,
        camera: Camera,
        *,
        points: Sequence[Place] = (),
        outside: Sequence[Place] = (),
        box: tuple[float, float, float, float] | None = None,
    ) -> tuple[Mask, float]:
        """Return SAM's mask, at the size of `pixels`, and its estimate of the mask's IoU.

        Parameters
        ----------
        points : sequence of (float, float)
            Clicks on the object; x, y in pixels of the whole photo.
        outside : sequence of (float, float)
            Clicks beside it.
        box : tuple of 4 float, or None
            x0, y0, x1, y1 in pixels of the whole photo.

        Returns
        -------
        mask : array of shape [H, W], bool
        iou : float
            0 to 1.
        """
        scale = np.float32(self.scale(camera))
        places, corners = [*points, *outside], None if box is None else np.asarray(box, np.float32) * scale
        clicks = np.asarray(places, np.float32) * scale if places else None
        labels = np.asarray([1.0] * len(points) + [0.0] * len(outside), np.float32) if places else None
        found = self._sam.predict(self._embedding(camera.photo), clicks, labels, corners)
        return found.mask, float(np.clip(found.iou, 0, 1))
