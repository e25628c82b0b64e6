"""A background that stands still is named as the cause of a failure, and nothing else is."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.cameras.features import SfmWorkspace, match_features
from engine.cameras.settings import CameraSettings
from engine.cameras.sfm import estimate_cameras
from engine.cameras.still_background import still_background
from engine.core.errors import CameraError
from engine.core.events import never_stop
from engine.photos.reading import read_photos
from engine.photos.settings import PhotoSettings

from ..turntable import write_turntable
from .conftest import Scene

QUICK = CameraSettings(max_side=400, max_features=1000, first_octave=0)


def test_turntable_before_a_still_background_is_told_and_masks_are_offered(tmp_path: Path) -> None:
    write_turntable(tmp_path / "photos", 5)
    photo_set = read_photos(tmp_path / "photos", PhotoSettings(blur_ratio=0.0))
    assert len(photo_set.photos) == 5
    with pytest.raises(CameraError) as raised:
        estimate_cameras(photo_set, tmp_path / "sfm", QUICK)
    said = str(raised.value)
    assert "The background stands still while the object moves, as on a turntable" in said
    assert "--mask-background" in said and "--photo-masks" in said
    assert "too few photos" not in said


def test_photos_taken_around_a_scene_have_no_still_background(room: Scene, tmp_path: Path) -> None:
    workspace = SfmWorkspace(tmp_path, room.photo_set, QUICK)
    match_features(workspace, report=lambda done, message: None, should_stop=never_stop)
    assert still_background(workspace) is None
