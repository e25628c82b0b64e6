"""Options that name a photo find it by the end of its path, in any case and suffix."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.cli.commands.named_photos import known_photo, points_in_known_photos, prompt_in_known_photos
from engine.core.errors import PromptError
from engine.objects.prompts import BoxPrompt, ClickPrompt, MaskPrompt, Point, TextPrompt
from engine.scene import Camera, CameraSet, write_camera_set

NAMES = ("cam1/0001.jpg", "cam2/0001.jpg", "Krüge Öl.jpg")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    cameras = tuple(Camera(name, 40, 30, "PINHOLE", (35.0, 35.0, 20.0, 15.0), np.eye(4)) for name in NAMES)
    points = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
    write_camera_set(tmp_path / "cameras", CameraSet(cameras, ("lost.png",), *points, 0.5, np.eye(4), False))
    return tmp_path


@pytest.mark.parametrize("name", ["cam2/0001.jpg", "CAM2/0001.JPG", "cam2\\0001", "/scan/photos/cam2/0001.png"])
def test_a_photo_is_named_by_the_end_of_its_path(project: Path, name: str) -> None:
    click = ClickPrompt(name, 1, 2, more=(Point("krüge_öl", 3, 4),), excluded=(Point("lost", 5, 6),))
    known = ClickPrompt(NAMES[1], 1, 2, more=(Point(NAMES[2], 3, 4),), excluded=(Point("lost.png", 5, 6),))
    assert prompt_in_known_photos(click, project) == known
    assert prompt_in_known_photos(BoxPrompt(name, 1, 2, 9, 9), project) == BoxPrompt(NAMES[1], 1, 2, 9, 9)
    assert prompt_in_known_photos(MaskPrompt(name, Path("m.png")), project) == MaskPrompt(NAMES[1], Path("m.png"))
    assert points_in_known_photos([Point(name, 1, 2)], project) == (Point(NAMES[1], 1, 2),)
    assert prompt_in_known_photos(TextPrompt("vase"), project) == TextPrompt("vase")


def test_a_name_that_several_photos_fit_is_refused_with_them(project: Path) -> None:
    with pytest.raises(
        PromptError, match=r"'0001\.jpg' may be cam1/0001\.jpg or cam2/0001\.jpg\. Give more of the pho"
    ):
        prompt_in_known_photos(ClickPrompt("0001.jpg", 1, 1), project)


def test_a_name_that_no_photo_fits_stays_for_the_message(project: Path) -> None:
    assert known_photo("other.jpg", NAMES) == "other.jpg"
    assert prompt_in_known_photos(ClickPrompt("other.jpg", 1, 1), project).photo == "other.jpg"
