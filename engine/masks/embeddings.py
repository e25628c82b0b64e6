"""SAM's embeddings of photos on disk, ``masks/<photo name>.sam.npz``, so that no photo is encoded twice.

Embeddings are derived data: one that is missing, damaged or of other pixels is computed again. They are stored in half
precision, 2 MB per photo. See docs/design_notes/masks.md for the effect of rounding on masks.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.files import ArraySpec, derived_name, keep_arrays, path_within, read_kept_arrays
from ..project.folder import stage_key
from .sam import INPUT_SIDE, Embedding, SegmentAnything
from .settings import MAX_EMBEDDINGS

_VERSION = 1
_SUFFIX = ".sam.npz"
_FEATURES = ArraySpec("float16", (1, 256, 64, 64))


class EmbeddingFolder:
    """Cache of embeddings in the ``masks`` folder of a project.

    Parameters
    ----------
    folder : Path
        Need not exist yet.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def encode(self, photo: str, pixels: NDArray[np.uint8], sam: SegmentAnything) -> Embedding:
        """Return the embedding of a photo, read from the folder if it is stored there, else computed and stored.

        The values are rounded to half precision in both cases, so that results do not depend on whether the embedding
        was stored. A file that cannot be written is ignored.

        Parameters
        ----------
        photo : str
            Name of the photo.
        pixels : array of shape [H, W, 3], uint8, sRGB

        Raises
        ------
        MaskError
            When `pixels` has another shape or type.
        """
        path = path_within(self._folder, derived_name(photo, _SUFFIX))
        recipe = stage_key(
            _VERSION, sam.name, pixels.shape, hashlib.sha256(np.ascontiguousarray(pixels).data).hexdigest()
        )
        stored = _read(path, recipe)
        if stored is not None:
            height, width = pixels.shape[:2]
            return Embedding(stored.astype(np.float32), height, width, INPUT_SIDE / max(height, width))
        computed = sam.encode(pixels)
        half = computed.features.astype(np.float16)
        if path.exists() or sum(1 for _ in self._folder.rglob(f"*{_SUFFIX}")) < MAX_EMBEDDINGS:
            keep_arrays(path, recipe, {"features": half})
        return Embedding(half.astype(np.float32), computed.height, computed.width, computed.scale)

    def copied(self, folder: Path, photos: Iterable[str]) -> EmbeddingFolder:
        """Return a cache in another folder with copies of what is stored of these photos; this one is only read."""
        for photo in photos:
            name = derived_name(photo, _SUFFIX)
            stored, copy = path_within(self._folder, name), path_within(folder, name)
            if stored.is_file():
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(stored, copy)
        return EmbeddingFolder(folder)


def _read(path: Path, recipe: str) -> NDArray[np.float16] | None:
    """Return the features at `path`; None unless the file is intact and was computed with `recipe`."""
    stored = read_kept_arrays(path, recipe, {"features": _FEATURES})
    return None if stored is None else stored["features"]
