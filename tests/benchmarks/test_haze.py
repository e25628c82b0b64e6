from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.haze import Figures, figures, table, unseen_frames
from engine.objects import Views
from engine.pictures import Scene
from tests.engine.pictures.blob_scene import BLUE, FLOOR, BlobScene, make_scene


@pytest.fixture
def blobs() -> BlobScene:
    return make_scene()


@pytest.fixture
def views(blobs: BlobScene) -> Views:
    return Views(Scene(blobs.gaussians), blobs.cameras, render_side=160)


def test_unseen_views_are_higher_nearer_and_farther_than_the_photos(views: Views, blobs: BlobScene) -> None:
    members = blobs.part == BLUE
    middle = np.median(blobs.gaussians.means[members], axis=0)
    frames = list(unseen_frames(views, members))
    n_photos = min(8, len(views.facing(middle)))
    assert len(frames) == 3 * n_photos
    offsets = np.array([frame.center - middle for frame in frames])
    distances = np.linalg.norm(offsets, axis=1).reshape(n_photos, 3)
    np.testing.assert_allclose(distances[:, 1:], distances[:, :1] * [0.5, 1.5], rtol=1e-5)
    heights = np.degrees(np.arcsin(offsets[:, 2].reshape(n_photos, 3) / distances))
    np.testing.assert_allclose(heights[:, 0], np.minimum(heights[:, 2] + 20, 80), atol=1e-3)
    photos = [np.linalg.norm(camera.center - middle) for camera in views.facing(middle)]
    assert all(np.isclose(photos, distance, rtol=1e-5).any() for distance in distances[:, 0])


def test_haze_and_what_is_missing_are_counted_apart(views: Views, blobs: BlobScene) -> None:
    members = blobs.part == BLUE
    frames = list(unseen_frames(views, members))
    ball, opaque = blobs.gaussians[members], np.full(members.sum(), 9.0, np.float32)
    ball = replace(ball, opacity_logits=opaque)
    true = [Scene(ball).render(frame, color=True).alpha > 0.5 for frame in frames]
    exact = figures(ball, frames, true)
    half = figures(ball[np.arange(members.sum()) % 8 == 0], frames, true)
    with_floor = members | (blobs.part == FLOOR)
    more = figures(blobs.gaussians[with_floor], frames, true)
    assert half.missing > exact.missing + 10 and half.haze <= exact.haze
    assert more.haze > exact.haze + 50
    assert exact.haze < 20


def test_the_table_has_means_and_the_worst() -> None:
    pairs = [(Figures(10, 2, 30), Figures(4, 1, 0)), (Figures(20, 4, 10), Figures(8, 3, 0))]
    last = table({"room_1": pairs, "room_2": pairs[:1]}).splitlines()[-1]
    assert last == "| **all** | 3 | 13.3 | 5.3 | 20 | 8 | 2.7 | 1.7 | 23 | 0 |"
