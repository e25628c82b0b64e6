"""Training views: undistorted, reduced to the maximum size, with labels of the same pixels."""

from __future__ import annotations

import mmap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import Cancelled, DiskError, TrainingError
from engine.masks.storage import write_label_map
from engine.scene.camera import Camera, CameraSet
from engine.training import views as views_module
from engine.training.settings import PRESETS
from engine.training.views import ViewPyramid, is_held_out, load_views, scene_extent

from .conftest import Scene

SETTINGS = PRESETS["test"].changed(max_side=60, held_out_every=3)


def project(folder: Path, n: int = 4) -> tuple[CameraSet, dict[str, Path]]:
    """`n` photos 120x80 with a white square on black, and a label map of half that size for the first two."""
    pixels = np.zeros((80, 120, 3), np.uint8)
    pixels[20:60, 40:80] = 255
    cameras, masks = [], {}
    for index in range(n):
        name = f"{index}.png"
        Image.fromarray(pixels).save(folder / name)
        viewmat = np.eye(4)
        viewmat[0, 3] = index
        cameras.append(Camera(name, 120, 80, "SIMPLE_RADIAL", (100.0, 60.0, 40.0, 0.02), viewmat))
        if index < 2:
            masks[name] = folder / f"{index}.npz"
            write_label_map(masks[name], (pixels[::2, ::2, 0] > 0).astype(np.int32) * 7)
    points = np.random.default_rng(0).normal(size=(700, 3)).astype(np.float32)
    colors = np.zeros((700, 3), np.uint8)
    return CameraSet(tuple(cameras), (), points, colors, 0.5, np.eye(4), False), masks


def test_pictures_and_segments_share_one_small_frame(tmp_path: Path) -> None:
    camera_set, masks = project(tmp_path)
    views = load_views(tmp_path, camera_set, masks, SETTINGS)
    assert [view.held_out for view in views] == [False, True, False, False]
    assert [view.labels is not None for view in views] == [True, True, False, False]
    for view in views:
        height, width = view.pixels.shape[:2]
        assert (view.pinhole.width, view.pinhole.height) == (width, height)
        assert max(width, height) <= 60
    square = views[0].pixels[..., 0] > 127
    assert views[0].labels is not None
    labelled = views[0].labels.array() == 7
    agreement = (square & labelled).sum() / (square | labelled).sum()
    assert agreement > 0.85


def test_segments_are_not_read_when_no_features_are_wanted(tmp_path: Path) -> None:
    camera_set, masks = project(tmp_path)
    views = load_views(tmp_path, camera_set, masks, SETTINGS.changed(train_features=False))
    assert all(view.labels is None for view in views)


def test_loading_stops_on_request(tmp_path: Path) -> None:
    camera_set, masks = project(tmp_path)
    with pytest.raises(Cancelled):
        load_views(tmp_path, camera_set, masks, SETTINGS, should_stop=lambda: True)


def test_a_halved_view_shows_the_same_point_at_half_the_pixel(scene: Scene) -> None:
    pyramid = ViewPyramid(scene.views, SETTINGS.features)
    full, half = pyramid.level(0, 0), pyramid.level(0, 2)
    assert half.pixels.shape == (24, 32, 3)
    point = full.camera.viewmat[:3, :3] @ [0.3, -0.2, 0.1] + full.camera.viewmat[:3, 3]
    pixels = [(level.camera.K @ point)[:2] / point[2] for level in (full, half)]
    assert np.allclose(pixels[0], 2 * pixels[1])
    assert np.allclose(half.pixels.mean(), full.pixels.mean(), atol=1)


def test_masks_and_transparency_follow_the_lens_into_the_training_pictures(tmp_path: Path) -> None:
    camera_set, masks = project(tmp_path)
    black = np.zeros((80, 120), bool)
    black[20:60, 40:80] = True
    Image.fromarray(~black).save(tmp_path / "mask.png")
    with Image.open(tmp_path / "2.png") as photo:
        Image.fromarray(np.dstack([np.asarray(photo), 255 - 255 * black.astype(np.uint8)])).save(tmp_path / "2.png")
    views = load_views(tmp_path, camera_set, masks, SETTINGS, photo_masks={"0.png": tmp_path / "mask.png"})
    assert views[1].valid is None and views[3].valid is None
    assert views[0].valid is not None
    # Transparent pixels are not unknown: nothing is there, which is black before the background of training.
    # But for a margin around what is not transparent.
    assert views[2].valid is not None and views[2].valid.mean() > 0.9
    hole = views[2].valid & ~views[0].valid
    assert hole.sum() > 0.5 * (~views[0].valid).sum() and not views[2].pixels[hole].any()
    # The white square is what is masked; its border is mixed with black where pictures are made smaller.
    assert not views[0].pixels[views[0].valid].any()
    assert views[0].valid.mean() == pytest.approx(1 - 1600 / 9600, abs=0.06)
    assert views[0].labels is not None and not views[0].labels.array()[~views[0].valid].any()


def test_pictures_of_many_photos_lie_in_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    camera_set, masks = project(tmp_path)
    usual = load_views(tmp_path, camera_set, masks, SETTINGS, scratch=tmp_path / "scratch")
    assert not (tmp_path / "scratch").exists()
    monkeypatch.setattr(views_module, "MAX_PIXEL_BYTES", 3 * sum(view.pixels[..., 0].size for view in usual) - 1)
    views = load_views(tmp_path, camera_set, masks, SETTINGS, scratch=tmp_path / "scratch")
    assert all(np.array_equal(one.pixels, other.pixels) for one, other in zip(views, usual, strict=True))
    # No array of pixels owns memory, nor does its full size in the pyramid: all are parts of one map of a file.
    pyramid = ViewPyramid(views, SETTINGS.features, prepares_targets=False)
    pictures = [one for i, view in enumerate(views) for one in (view.pixels, pyramid.level(i, 0).pixels)]
    assert len({id(_owner(one)) for one in pictures}) == 1 and isinstance(_owner(pictures[0]), mmap.mmap)
    # Segments are small: less than a byte for a pixel.
    labels = [view.labels for view in views if view.labels is not None]
    assert len(labels) == 2 and all(one.nbytes < one.array().size for one in labels)


def _owner(array: Any) -> Any:
    """Return what holds the memory of an array."""
    while isinstance(array, np.ndarray | memoryview):
        array = array.base if isinstance(array, np.ndarray) else array.obj
    return array


def test_full_disk_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    camera_set, masks = project(tmp_path)
    monkeypatch.setattr(views_module, "MAX_PIXEL_BYTES", 0)
    (tmp_path / "scratch").write_bytes(b"")
    with pytest.raises(DiskError, match="Could not write"):
        load_views(tmp_path, camera_set, masks, SETTINGS, scratch=tmp_path / "scratch")


def test_a_reduced_pixel_is_valid_when_all_its_pixels_are_and_some_pixel_always_is(scene: Scene) -> None:
    valid = np.ones((48, 64), bool)
    valid[10, 11] = False
    checkered = np.indices((48, 64)).sum(axis=0) % 2 == 0
    views = [replace(scene.views[0], valid=valid), replace(scene.views[0], valid=checkered)]
    pyramid = ViewPyramid(views, SETTINGS.features)
    half = pyramid.level(0, 2).valid
    assert half is not None and [tuple(at) for at in np.argwhere(~half)] == [(5, 5)]
    finest = pyramid.level(1, 2).valid
    assert finest is not None and finest.all()


def test_a_photo_without_valid_pixels_is_refused(scene: Scene) -> None:
    view = replace(scene.views[0], valid=np.zeros((48, 64), bool))
    with pytest.raises(TrainingError, match="excludes all of its pixels"):
        ViewPyramid([view], SETTINGS.features)


def test_held_out_photos_give_no_segments_to_learn_from(scene: Scene) -> None:
    held_out = next(index for index, view in enumerate(scene.views) if view.held_out)
    pyramid = ViewPyramid(scene.views, PRESETS["test"].features)
    assert pyramid.level(held_out, 0).labelled is None
    assert pyramid.level(0, 0).labelled is not None


def test_every_nth_photo_is_held_out() -> None:
    assert [index for index in range(20) if is_held_out(index, 8)] == [4, 12]
    assert not any(is_held_out(index, 0) for index in range(20))


def test_extent_is_the_radius_of_the_cameras(scene: Scene) -> None:
    pinholes = [view.pinhole for view in scene.views]
    assert scene_extent(pinholes) == pytest.approx(1.1 * 2.5)
    assert scene_extent(pinholes[:1]) == 1.0


def test_no_photos_are_an_error() -> None:
    with pytest.raises(TrainingError, match="photo"):
        ViewPyramid([], SETTINGS.features)
