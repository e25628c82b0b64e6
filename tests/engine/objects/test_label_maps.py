"""Label maps of a project are read when they are used, and few are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine import masks
from engine.masks.storage import label_map_path, write_label_map
from engine.objects import context
from engine.scene import CameraSet
from tests.engine.pictures.blob_scene import BlobScene

N_MAPS = 40


def _segments(number: int) -> np.ndarray:
    y, x = np.mgrid[:60, :80]
    return ((x + y + number) // 16).astype(np.int32)


@pytest.fixture
def cameras(blobs: BlobScene, tmp_path: Path) -> CameraSet:
    """Cameras of 40 photos with a label map each, in `tmp_path`, and of one without."""
    one = blobs.cameras.cameras[0]
    for number in range(N_MAPS):
        write_label_map(label_map_path(tmp_path / "masks", f"{number}.jpg"), _segments(number))
    return replace(blobs.cameras, cameras=tuple(replace(one, photo=f"{number}.jpg") for number in range(N_MAPS + 1)))


def test_maps_in_any_order_are_those_of_the_files_in_bounded_memory(
    cameras: CameraSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(context, "_KEPT_BYTES", 20_000)
    maps = context.label_maps_of(tmp_path, cameras)
    assert len(maps) == N_MAPS and f"{N_MAPS}.jpg" not in maps and maps.get(f"{N_MAPS}.jpg") is None
    for number in np.random.default_rng(0).integers(0, N_MAPS, 200):
        assert np.array_equal(maps[f"{number}.jpg"], _segments(number))
        assert 0 < maps.n_bytes <= 20_000  # type: ignore[attr-defined]


def test_maps_used_last_are_not_read_again(cameras: CameraSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    monkeypatch.setattr(masks, "read_label_map", lambda file: read.append(file.name) or _segments(0))
    size = context.LabelRuns.of(_segments(0)).nbytes
    monkeypatch.setattr(context, "_KEPT_BYTES", 3 * size)
    maps = context.label_maps_of(tmp_path, cameras)
    for number in (0, 1, 2, 0, 3, 0, 2, 1):
        maps[f"{number}.jpg"]
    # 1 was used longest ago when 3 came.
    assert read == ["0.jpg.npz", "1.jpg.npz", "2.jpg.npz", "3.jpg.npz", "1.jpg.npz"]
