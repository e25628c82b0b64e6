"""The photos as the detector and SAM see them: read and encoded once and kept, in memory and on disk, within bounds."""

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

_KEPT_BYTES = 256_000_000
"""Of pixels: about a hundred photos at 1024 pixels."""

_KEPT_EMBEDDINGS = 32
"""4 MB each."""


class Photos:
    """Photos at the size the models see, each read and encoded by SAM once while there is room to keep it.

    Parameters
    ----------
    folder : Path
    side : int
        Longer side in pixels that photos are reduced to.
    sam_factory : callable
        Called when SAM is first needed.
    embeddings : EmbeddingFolder, optional
        Where SAM's embeddings outlive the process.
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
        """Return the photo, uint8 [H, W, 3]; not to be written to."""
        name = camera.photo
        if name not in self._pixels:
            pixels = load_pixels(self._folder / name, max_side=self._side)
            pixels.setflags(write=False)
            self._pixels[name] = pixels
            while len(self._pixels) > 1 and sum(kept.nbytes for kept in self._pixels.values()) > _KEPT_BYTES:
                self._pixels.popitem(last=False)
        self._pixels.move_to_end(name)
        return self._pixels[name]

    def scale(self, camera: Camera) -> float:
        """Return the size of `pixels` as a part of the photo's."""
        return self.pixels(camera).shape[1] / camera.width

    def segment(
        self,
        camera: Camera,
        *,
        points: Sequence[tuple[float, float]] = (),
        outside: Sequence[tuple[float, float]] = (),
        box: tuple[float, float, float, float] | None = None,
    ) -> tuple[NDArray[np.bool_], float]:
        """Return SAM's mask, bool [H, W] as `pixels`, and its guess of the IoU.

        Parameters
        ----------
        camera : Camera
        points, outside : sequence of (float, float)
            Pixels of the photo at full size on the object, and on what is not part of it.
        box : tuple of 4 float, optional
            x0, y0, x1, y1 in pixels of the photo at full size.
        """
        sam, embedding = self._encoded(camera)
        scale = self.scale(camera)
        clicks = np.asarray([*points, *outside], np.float32).reshape(-1, 2) * np.float32(scale)
        kinds = np.asarray([1.0] * len(points) + [0.0] * len(outside), np.float32)
        found = sam.predict(
            embedding,
            clicks if len(clicks) else None,
            kinds if len(clicks) else None,
            None if box is None else np.asarray(box, np.float32) * np.float32(scale),
        )
        return found.mask, float(np.clip(found.iou, 0, 1))

    def segment_scales(self, camera: Camera, box: tuple[float, float, float, float]) -> list[NDArray[np.bool_]]:
        """Return SAM's part, object and whole for a box as in `segment`, bool [H, W]; one of them where it has one."""
        sam, embedding = self._encoded(camera)
        return sam.masks_of_scales(embedding, box=np.asarray(box, np.float32) * np.float32(self.scale(camera)))

    def _encoded(self, camera: Camera) -> tuple[SegmentAnything, Embedding]:
        if self._sam is None:
            self._sam = self._sam_factory()
        name = camera.photo
        if name not in self._embeddings:
            pixels = self.pixels(camera)
            self._embeddings[name] = (
                self._sam.encode(pixels) if self._on_disk is None else self._on_disk.encode(name, pixels, self._sam)
            )
            if len(self._embeddings) > _KEPT_EMBEDDINGS:
                self._embeddings.popitem(last=False)
        self._embeddings.move_to_end(name)
        return self._sam, self._embeddings[name]
