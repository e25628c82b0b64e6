"""Pixels excluded by a photo's mask or transparency are not used to estimate cameras."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
from PIL import Image

from engine.cameras.features import SfmWorkspace, match_features
from engine.cameras.settings import CameraSettings
from engine.core.events import never_stop
from engine.photos.reading import read_photos
from engine.scene.photo import PhotoSet

from .conftest import HEIGHT, WIDTH, Scene

QUICK = CameraSettings(max_features=500)


def keypoints(photo_set: PhotoSet, folder: Path) -> list[np.ndarray]:
    """Return x and y of the features of each photo, in its pixels."""
    workspace = SfmWorkspace(folder, photo_set, QUICK)
    match_features(workspace, report=lambda done, message: None, should_stop=never_stop)
    with pycolmap.Database.open(workspace.database) as database:
        ids = {image.name: image.image_id for image in database.read_all_images()}
        return [database.read_keypoints(ids[copy.name])[:, :2] for copy in workspace.copies]


def test_no_feature_lies_in_excluded_pixels(room: Scene, tmp_path: Path) -> None:
    """The first photo has a mask, the second is partly transparent, the third is used completely."""
    photos, masks = tmp_path / "photos", tmp_path / "masks"
    photos.mkdir()
    masks.mkdir()
    valid = np.zeros((HEIGHT, WIDTH), np.uint8)
    valid[:, : WIDTH // 2] = 255
    for photo in room.photo_set.photos[:3]:
        pixels = np.asarray(Image.open(room.photo_set.folder / photo.name))
        pixels = np.dstack([pixels, valid]) if photo.name == "01.png" else pixels
        Image.fromarray(pixels).save(photos / photo.name)
    Image.fromarray(valid).save(masks / "00.png.png")
    found = read_photos(photos, masks=masks)
    first, second, third = keypoints(found, tmp_path / "sfm")
    assert len(first) > 50 and first[:, 0].max() <= WIDTH / 2
    assert len(second) > 50 and second[:, 0].max() <= WIDTH / 2
    assert third[:, 0].max() > 0.9 * WIDTH
    # After a mask was edited, the features found with the old one are not used.
    Image.fromarray(255 - valid).save(masks / "00.png.png")
    edited = keypoints(replace(read_photos(photos, masks=masks), rejected=()), tmp_path / "sfm")[0]
    assert len(edited) > 50 and edited[:, 0].min() >= WIDTH / 2 - 1
