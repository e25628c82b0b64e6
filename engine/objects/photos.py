"""Photos as the detector and SAM get them, with a bounded cache of pixels and of SAM's embeddings."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..photos import load_pixels
from ..scene import Camera
from .arrays import Mask, Pixels

if TYPE_CHECKING:
    from ..masks import Embedding, EmbeddingFolder, SegmentAnything

__all__ = ["Photos", "SamFactory"]

SamFactory = Callable[[], "SegmentAnything"]

_MAX_CACHED_BYTES = 256_000_000  # by definition
"""Largest size of the cached pixels in bytes, about a hundred photos at 1024 pixels."""

_MAX_CACHED_EMBEDDINGS = 32  # by definition
"""Embeddings of SAM that are cached in memory, at most, 4 MB each."""


class Photos:
    """Photos of a folder, reduced to `side` pixels on the longer side for the models.

    Each is read, and encoded by SAM, once as long as the cache holds it. `sam_factory` is called when SAM is first
    needed; `embeddings` caches what it encodes on disk.
    """

    def __init__(
        self, folder: Path, side: int, sam_factory: SamFactory, embeddings: EmbeddingFolder | None = None
    ) -> None:
        self._folder, self._side, self._sam_factory, self._on_disk = folder, side, sam_factory, embeddings
        self._sam: SegmentAnything | None = None
        self._pixels: OrderedDict[str, Pixels] = OrderedDict()
        self._embeddings: OrderedDict[str, Embedding] = OrderedDict()

    def pixels(self, camera: Camera) -> Pixels:
        """Return the photo, uint8 [H, W, 3], read-only."""
        name = camera.photo
        if name not in self._pixels:
            self._pixels[name] = load_pixels(self._folder / name, max_side=self._side)
            self._pixels[name].setflags(write=False)
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
    ) -> tuple[Mask, float]:
        """Return SAM's mask, bool [H, W] at the size of `pixels`, and its estimate of the mask's IoU.

        The `points` on the object, those `outside` of it, and `box`, x0, y0, x1, y1, are in pixels of the whole photo.
        """
        scale, pixels, name = np.float32(self.scale(camera)), self.pixels(camera), camera.photo
        self._sam = sam = self._sam or self._sam_factory()
        if name not in self._embeddings:
            on_disk = self._on_disk
            self._embeddings[name] = sam.encode(pixels) if on_disk is None else on_disk.encode(name, pixels, sam)
            if len(self._embeddings) > _MAX_CACHED_EMBEDDINGS:
                self._embeddings.popitem(last=False)
        self._embeddings.move_to_end(name)
        places, corners = [*points, *outside], None if box is None else np.asarray(box, np.float32) * scale
        clicks = np.asarray(places, np.float32) * scale if places else None
        labels = np.asarray([1.0] * len(points) + [0.0] * len(outside), np.float32) if places else None
        found = sam.predict(self._embeddings[name], clicks, labels, corners)
        return found.mask, float(np.clip(found.iou, 0, 1))
