"""What the tests of several rooms share."""

from __future__ import annotations

import pytest

from tests.engine.pictures.blob_scene import BlobScene, make_scene


@pytest.fixture(scope="session")
def blobs() -> BlobScene:
    """The blob scene, made once."""
    return make_scene()
