from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import DiskError, ObjectError, SettingsError
from engine.masks.mask_metrics import iou
from engine.pictures.png import write_png
from engine.pictures.render import DEPTH_STEPS_PER_UNIT, render_view
from tests.engine.pictures.blob_scene import BLUE, FLOOR, RED, BlobScene, as_pinhole


def test_picture_from_a_photos_camera_is_the_photo(blobs: BlobScene) -> None:
    camera = blobs.cameras.cameras[2]
    picture = render_view(blobs.gaussians, camera)
    photo = blobs.pixels[camera.photo]
    assert picture.shape == photo.shape and picture.dtype == np.uint8
    assert np.abs(picture.astype(int) - photo).mean() < 2


def test_single_object_is_rendered_over_black(blobs: BlobScene) -> None:
    camera = blobs.cameras.cameras[0]
    picture = render_view(blobs.gaussians, camera, members=blobs.part == BLUE)
    assert (picture[:10] == 0).all()
    assert (picture[..., 2].astype(int) - picture[..., 0] > 60).sum() > 100


@pytest.mark.parametrize("index", range(8))
def test_mask_of_an_object_is_its_visible_part(blobs: BlobScene, index: int) -> None:
    camera = blobs.cameras.cameras[index]
    mask = render_view(blobs.gaussians, camera, what="mask", members=blobs.part == RED)
    assert set(np.unique(mask)) <= {0, 255}
    assert iou(mask > 0, blobs.labels[camera.photo] == RED) > 0.97


def test_depth_is_in_thousandths_of_a_unit_and_0_where_nothing_is_covered(blobs: BlobScene) -> None:
    camera = as_pinhole(blobs.cameras.cameras[1])
    depth = render_view(blobs.gaussians, camera, what="depth")
    assert depth.dtype == np.uint16
    floor = blobs.gaussians.means[blobs.part == FLOOR]
    distance = floor @ camera.viewmat[2, :3] + camera.viewmat[2, 3]
    seen = depth[depth > 0] / DEPTH_STEPS_PER_UNIT
    assert distance.min() - 0.4 < seen.min() and seen.max() < distance.max() + 0.1
    assert (depth == 0).any()


def test_features_and_instances_separate_the_parts(blobs: BlobScene) -> None:
    camera = blobs.cameras.cameras[3]
    for what in ("features", "instances"):
        picture = render_view(blobs.gaussians, camera, what=what)  # type: ignore[arg-type]
        labels = blobs.labels[camera.photo]
        centers = [blobs.center_of(part, camera.photo) for part in np.unique(labels)]
        colors = [picture[int(y), int(x)].astype(int) for x, y in centers]
        gaps = [np.abs(a - b).sum() for i, a in enumerate(colors) for b in colors[:i]]
        assert min(gaps) > 40


def test_an_object_keeps_its_instance_colour_in_every_view(blobs: BlobScene) -> None:
    colors = set()
    for camera in blobs.cameras.cameras[:3]:
        x, y = blobs.center_of(BLUE, camera.photo)
        colors.add(tuple(render_view(blobs.gaussians, camera, what="instances")[int(y), int(x)]))
    assert len(colors) == 1


def test_click_gives_the_whole_instance(blobs: BlobScene) -> None:
    camera = blobs.cameras.cameras[0]
    mask = render_view(blobs.gaussians, camera, what="features", click=blobs.center_of(BLUE, camera.photo))
    assert mask.shape == (camera.height, camera.width)
    assert iou(mask > 0, blobs.labels[camera.photo] == BLUE) > 0.9


def test_click_on_nothing_is_black(blobs: BlobScene) -> None:
    assert not render_view(blobs.gaussians, blobs.cameras.cameras[0], what="instances", click=(1, 1)).any()


def test_invalid_requests_are_refused(blobs: BlobScene) -> None:
    camera = blobs.cameras.cameras[0]
    with pytest.raises(SettingsError, match="--object"):
        render_view(blobs.gaussians, camera, what="mask")
    with pytest.raises(SettingsError, match="outside of the picture, 160 x 120"):
        render_view(blobs.gaussians, camera, what="features", click=(160, 5))
    with pytest.raises(SettingsError, match="goes with"):
        render_view(blobs.gaussians, camera, what="rgb", click=(1, 5))
    with pytest.raises(ObjectError, match="without segmentation features"):
        render_view(replace(blobs.gaussians, features=None), camera, what="features")
    with pytest.raises(ObjectError, match="Isolate it again"):
        render_view(blobs.gaussians, camera, what="mask", members=np.ones(3, bool))


def test_object_without_gaussians_gives_an_empty_picture(blobs: BlobScene) -> None:
    nobody = np.zeros(len(blobs.gaussians), bool)
    camera = blobs.cameras.cameras[0]
    assert not render_view(blobs.gaussians, camera, members=nobody).any()
    assert not render_view(blobs.gaussians, camera, what="depth", members=nobody).any()


def test_png_comes_back_as_it_was(tmp_path: Path) -> None:
    depth = np.arange(60, dtype=np.uint16).reshape(6, 10) * 1000
    write_png(tmp_path / "depth.png", depth, description="thousandths")
    with Image.open(tmp_path / "depth.png") as picture:
        assert picture.text["Description"] == "thousandths"  # type: ignore[attr-defined]
        np.testing.assert_array_equal(np.asarray(picture), depth)
    assert [path.name for path in tmp_path.iterdir()] == ["depth.png"]


def test_png_in_an_impossible_place_is_a_disk_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DiskError):
        write_png(tmp_path / "file" / "picture.png", np.zeros((2, 2, 3), np.uint8))
