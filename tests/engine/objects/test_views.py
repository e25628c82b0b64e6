from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from engine.core.errors import SettingsError
from engine.objects import views as views_module
from engine.objects.settings import DEFAULT_PRESET, PAPER, PRESETS, SegmentSettings
from engine.objects.views import Views, erode_mask, spread_cameras
from engine.pictures.scene import Scene
from tests.engine.pictures.blob_scene import BlobScene


def test_thin_masks_survive_erosion() -> None:
    line = np.zeros((20, 20), bool)
    line[10] = True
    assert erode_mask(line, 3).any()


def test_sampled_views_are_spread_and_none_twice(blobs: BlobScene) -> None:
    chosen = spread_cameras(blobs.cameras.cameras, 4)
    centers = np.stack([camera.center for camera in chosen])
    gaps = np.linalg.norm(centers[:, None] - centers[None], axis=-1)[np.triu_indices(4, 1)]
    assert gaps.min() > 1.5
    assert len(spread_cameras(blobs.cameras.cameras, 99)) == len(blobs.cameras.cameras)


def test_settings_out_of_bounds_are_refused() -> None:
    assert DEFAULT_PRESET in PRESETS and PAPER.cosine == 0.7
    for field, value in (("strictness", 0.0), ("n_text_views", 0)):
        with pytest.raises(SettingsError, match=f"SegmentSettings.{field}"):
            SegmentSettings(**{field: value})  # type: ignore[arg-type]
    for field, value in (("cosine", 1.0), ("outlier_iqr", 0.0), ("photo_side", 2)):
        with pytest.raises(SettingsError, match=f"PaperSettings.{field}"):
            replace(PAPER, **{field: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("n_cameras", [1, 8])
def test_unit_of_lengths_is_how_far_the_cameras_are_from_the_scene(n_cameras: int, blobs: BlobScene) -> None:
    cameras = blobs.cameras.cameras[:n_cameras]
    views = Views(Scene(blobs.gaussians), replace(blobs.cameras, cameras=cameras), render_side=160)
    distances = [np.linalg.norm(camera.center - np.median(blobs.gaussians.means, axis=0)) for camera in cameras]
    assert views.length_unit == pytest.approx(np.median(distances), rel=1e-5)


def test_views_of_any_number_of_photos_keep_the_features_of_few(
    blobs: BlobScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(views_module, "_N_KEPT", 3)
    views = Views(Scene(blobs.gaussians), blobs.cameras, render_side=40)
    cameras = blobs.cameras.cameras[:6]
    features = []
    for camera in cameras:
        view = views.of(camera)
        assert views.of(camera) is view
        features.append(weakref.ref(view.features))
    del view
    gc.collect()
    # The scene keeps sorted Gaussians, not what was rendered of them.
    assert [one() is not None for one in features] == [False, False, False, True, True, True]


def test_view_keeps_no_more_than_its_features(blobs: BlobScene) -> None:
    view = Views(Scene(blobs.gaussians), blobs.cameras, render_side=40).of(blobs.cameras.cameras[0])
    assert view.covered.any()
    kept = [one for value in vars(view).values() for one in (value if isinstance(value, tuple) else (value,))]
    arrays = [one for one in kept if isinstance(one, np.ndarray)]
    assert sum(one.nbytes for one in arrays) == view.features.nbytes + 2 * view.within.nbytes
