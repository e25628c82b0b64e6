"""The object is told from a background that stands still, and masks of it are written for all photos."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import Cancelled, MaskError
from engine.core.events import ignore_events, never_stop
from engine.masks import mask_iou
from engine.masks.foreground import make_foreground_masks
from engine.masks.sam import SegmentAnything
from engine.photos.photo_masks import with_masks
from engine.photos.reading import read_photos
from engine.photos.settings import PhotoSettings
from engine.scene import PhotoSet

from ..turntable import write_turntable


def photos_of(folder: Path) -> PhotoSet:
    return read_photos(folder, PhotoSettings(blur_ratio=0.0))


def test_object_on_a_turntable_is_kept_and_its_background_left_out(tmp_path: Path, sam: SegmentAnything) -> None:
    truth = write_turntable(tmp_path / "photos", 4)
    photo_set = photos_of(tmp_path / "photos")
    make_foreground_masks(photo_set, tmp_path / "masks", lambda: sam, emit=ignore_events, should_stop=never_stop)
    photos = with_masks(
        photo_set.folder, photo_set.photos, tmp_path / "masks", emit=ignore_events, should_stop=never_stop
    )
    assert len(photos) == 4
    for photo in photos:
        mask = np.asarray(Image.open(photo.mask or "")) > 0
        # The mask is widened by a few pixels around the disc of 110 pixels.
        assert mask_iou(mask, truth) > 0.85, photo.name
        assert (mask & truth).sum() / truth.sum() > 0.97, photo.name


class NoObject(SegmentAnything):
    """A SAM that finds the whole frame."""

    def __init__(self) -> None:
        pass

    def encode(self, pixels):  # type: ignore[no-untyped-def]
        from engine.masks.sam import Embedding

        return Embedding(np.zeros((1, 256, 64, 64), np.float32), *pixels.shape[:2], 1024 / max(pixels.shape))

    def predict(self, embedding, *prompt):  # type: ignore[no-untyped-def]
        from engine.masks.sam import Prediction

        return Prediction(np.ones((embedding.height, embedding.width), bool), 0.9)


def test_photos_without_an_object_are_an_error_and_a_stop_is_obeyed(tmp_path: Path) -> None:
    write_turntable(tmp_path / "photos", 3)
    photo_set = photos_of(tmp_path / "photos")
    with pytest.raises(MaskError, match="found no object before the background"):
        make_foreground_masks(photo_set, tmp_path / "m", NoObject, emit=ignore_events, should_stop=never_stop)
    with pytest.raises(Cancelled):
        make_foreground_masks(photo_set, tmp_path / "m", NoObject, emit=ignore_events, should_stop=lambda: True)
