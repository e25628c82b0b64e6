"""Photos as the detector and SAM get them, with a bounded cache of pixels and of SAM's embeddings."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..photos import load_pixels
from ..scene import Camera

if TYPE_CHECKING:
    from ..masks import Embedding, EmbeddingFolder, SegmentAnything

__all__ = ["Photos", "SamFactory"]

SamFactory = Callable[[], "SegmentAnything"]

_MAX_CACHED_BYTES = 256_000_000  # by definition
"""Largest size of the cached pixels in bytes, about a hundred photos at 1024 pixels."""

_MAX_CACHED_EMBEDDINGS = 32  # by definition
"""Embeddings of SAM that are cached in memory, at most, 4 MB each."""


class Photos:
    """Photos at the size that the models get. Each is read, and encoded by SAM, once as long as the cache holds it.

    Parameters
    ----------
    folder : Path
    side : int
        Longer side in pixels to which photos are reduced.
    sam_factory : callable
        Called when SAM is first needed.
    embeddings : EmbeddingFolder, optional
        Cache of SAM's embeddings on disk.
    """

    def __init__(
        self, folder: Path, side: int, sam_factory: SamFactory, embeddings: EmbeddingFolder | None = None
    ) -> None:
        self._folder, self._side, self._sam_factory = folder, side, sam_factory
        self._on_disk = embeddings
        self._sam: SegmentAnything | None = None
        self._pixels: OrderedDict[str, NDArray[np.uint8]] = OrderedDict()
        self._embeddings: OrderedDict[str, Embedding] = OrderedDict()

    def pixels(self, camera: Camera) -> NDArray[np.uint8]:
        """Return the photo, uint8 [H, W, 3], read-only."""
        name = camera.photo
        if name not in self._pixels:
            pixels = load_pixels(self._folder / name, max_side=self._side)
            pixels.setflags(write=False)
            self._pixels[name] = pixels
            while len(self._pixels) > 1 and sum(kept.nbytes for kept in self._pixels.values()) > _MAX_CACHED_BYTES:
                self._pixels.popitem(last=False)
        self._pixels.move_to_end(name)
        return self._pixels[name]

    def scale(self, camera: Camera) -> float:
        """Return the size of `pixels` relative to the photo at full size."""
        return self.pixels(camera).shape[1] / camera.width

    def segment(
        self,
        camera: Camera,
        *,
        points: Sequence[tuple[float, float]] = (),
        outside: Sequence[tuple[float, float]] = (),
        box: tuple[float, float, float, float] | None = None,
    ) -> tuple[NDArray[np.bool_], float]:
        """Return SAM's mask, bool [H, W] at the size of `pixels`, and its estimate of the mask's IoU.

        Parameters
        ----------
        camera : Camera
        points, outside : sequence of (float, float)
            Points on the object, and on what is not part of it, in pixels of the photo at full size.
        box : tuple of 4 float, optional
            x0, y0, x1, y1 in pixels of the photo at full size.
        """
        sam, embedding = self._encoded(camera)
        scale = self.scale(camera)
        clicks = np.asarray([*points, *outside], np.float32).reshape(-1, 2) * np.float32(scale)
        labels = np.asarray([1.0] * len(points) + [0.0] * len(outside), np.float32)
        found = sam.predict(
            embedding,
            clicks if len(clicks) else None,
            labels if len(clicks) else None,
            None if box is None else np.asarray(box, np.float32) * np.float32(scale),
        )
        return found.mask, float(np.clip(found.iou, 0, 1))

    def _encoded(self, camera: Camera) -> tuple[SegmentAnything, Embedding]:
        if self._sam is None:
            self._sam = self._sam_factory()
        name = camera.photo
        if name not in self._embeddings:
            pixels = self.pixels(camera)
            self._embeddings[name] = (
                self._sam.encode(pixels) if self._on_disk is None else self._on_disk.encode(name, pixels, self._sam)
            )
            if len(self._embeddings) > _MAX_CACHED_EMBEDDINGS:
                self._embeddings.popitem(last=False)
        self._embeddings.move_to_end(name)
        return self._sam, self._embeddings[name]
