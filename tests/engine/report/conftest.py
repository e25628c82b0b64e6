"""The blob scene, made once."""

from __future__ import annotations

import pytest

from tests.engine.pictures.blob_scene import BlobScene, make_scene


@pytest.fixture(scope="session")
def blobs() -> BlobScene:
    return make_scene()
