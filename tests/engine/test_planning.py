"""The plan: only what the scene needs, and the rest is listed with its reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from engine.cameras.camera import Camera, CameraSet
from engine.photos.photo import Photo, PhotoSet
from engine.planning import PlanSettings, plan_scene, spread


def scene(n_photos: int, *, poses_given: bool = False) -> tuple[PhotoSet, CameraSet]:
    names = [f"{i:03}.jpg" for i in range(n_photos)]
    photos = PhotoSet(Path("photos"), tuple(Photo(name, 800, 600, None, "") for name in names), ())
    cameras = tuple(Camera(name, 800, 600, "PINHOLE", (700.0, 700.0, 400.0, 300.0), np.eye(4)) for name in names)
    points = np.zeros((0, 3), np.float32)
    return photos, CameraSet(cameras, (), points, points.astype(np.uint8), 0.5, np.eye(4), poses_given)


def test_masks_are_spread_and_never_more_than_wanted() -> None:
    photos, cameras = scene(48)
    plan = plan_scene(photos, cameras, PlanSettings(n_mask_photos=28), held_out_every=8)
    assert 24 <= len(plan.mask_photos) <= 28
    gaps = np.diff([int(name[:3]) for name in plan.mask_photos])
    assert gaps.max() <= 4


def test_some_held_out_photos_get_masks_to_judge_the_features() -> None:
    plan = plan_scene(*scene(48), PlanSettings(), held_out_every=8)
    assert set(plan.held_out) & set(plan.mask_photos)
    assert not set(plan.held_out) >= set(plan.mask_photos)


def test_small_sets_get_masks_for_every_photo() -> None:
    photos, cameras = scene(16)
    plan = plan_scene(photos, cameras, PlanSettings(), held_out_every=8)
    assert set(plan.mask_photos) == {photo.name for photo in photos.photos}


def test_without_objects_masks_and_features_are_left_out_and_said() -> None:
    plan = plan_scene(*scene(16), PlanSettings(wants_objects=False), held_out_every=8)
    assert plan.mask_photos == ()
    assert not plan.features
    assert any("no objects were asked for" in left_out.why for left_out in plan.left_out)


def test_given_poses_leave_out_structure_from_motion() -> None:
    plan = plan_scene(*scene(16, poses_given=True), PlanSettings(), held_out_every=8)
    assert any(left_out.what == "structure from motion" for left_out in plan.left_out)


def test_three_photos_spare_none() -> None:
    plan = plan_scene(*scene(3), PlanSettings(), held_out_every=8)
    assert plan.held_out == ()
    assert any(left_out.what == "held-out photos" for left_out in plan.left_out)


def test_spread_keeps_order_and_ends() -> None:
    names = [str(i) for i in range(10)]
    assert spread(names, 3) == ("1", "5", "8")
    assert spread(names, 20) == tuple(names)
