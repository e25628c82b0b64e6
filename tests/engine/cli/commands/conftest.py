"""What the tests of several commands share."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BlobScene


@pytest.fixture
def scene(blobs: BlobScene, tmp_path: Path) -> Path:
    """A project of the blob scene, as if it had been trained."""
    return trained_project(blobs, tmp_path).path
