"""The generated scenes are whole: photos, cameras, masks and names belong together; every exhibit is seen often."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.conftest import ROOT

SIZES = {"museum_room": (48, 12e6), "store_room": (36, 9e6)}
"""Photos, and bytes of the whole folder at most."""

_SEEN = 400
"""Pixels: a coin's worth, enough to tell an exhibit's shape."""


@pytest.fixture(params=sorted(SIZES))
def scene(request: pytest.FixtureRequest) -> Path:
    return ROOT / "demo" / str(request.param)


def truth(scene: Path, name: str) -> Any:
    return json.loads((scene / "truth" / name).read_text(encoding="utf-8"))


def ids_of(scene: Path) -> dict[str, np.ndarray]:
    found = {}
    for file in sorted((scene / "truth" / "masks").glob("*.png")):
        with Image.open(file) as picture:
            found[file.stem] = np.asarray(picture)
    return found


def test_every_photo_has_its_camera_and_its_mask(scene: Path) -> None:
    n_photos, most = SIZES[scene.name]
    photos = {path.stem for path in (scene / "photos").glob("*.jpg")}
    assert photos == {path.stem for path in (scene / "truth" / "masks").glob("*.png")}
    assert photos == {Path(camera["file"]).stem for camera in truth(scene, "cameras.json")["photos"]}
    assert len(photos) == n_photos
    files = [path for path in scene.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert sum(path.stat().st_size for path in files) <= most


def test_photos_are_as_the_phone_that_the_truth_describes(scene: Path) -> None:
    for camera in truth(scene, "cameras.json")["photos"]:
        with Image.open(scene / "photos" / camera["file"]) as photo:
            assert photo.size == (camera["width"], camera["height"]) == (800, 600)
            exif = photo.getexif()
            assert "CC0" in exif[0x010E]
            equivalent = float(exif.get_ifd(0x8769)[0xA405])
        assert camera["params"]["f"] == pytest.approx(equivalent * 1000 / np.hypot(36, 24))
        world_to_camera = np.array(camera["world_to_camera"])
        assert np.allclose(world_to_camera[:3, :3] @ world_to_camera[:3, :3].T, np.eye(3), atol=1e-6)
        assert abs(camera["exposure_stops"]) <= 0.25


def test_masks_know_no_exhibit_without_a_name_and_show_every_one_often(scene: Path) -> None:
    names = truth(scene, "names.json")
    seen: Counter[int] = Counter()
    for ids in ids_of(scene).values():
        assert ids.shape == (600, 800)
        values, counts = np.unique(ids, return_counts=True)
        assert set(values.tolist()) <= {0, *map(int, names)}
        seen.update(int(value) for value, count in zip(values, counts, strict=True) if count >= _SEEN)
    assert {number: seen[int(number)] for number in names if seen[int(number)] < 20} == {}
    assert len({entry["name"] for entry in names.values()}) == len(names)


def test_absent_words_are_no_prompts_of_the_scene(scene: Path) -> None:
    absent = truth(scene, "absent.json")
    shown = {word for entry in truth(scene, "names.json").values() for word in entry["prompt"].split()}
    assert len(absent) == len(set(absent)) >= 10
    assert [word for word in absent if shown & set(word.split())] == []


def test_store_room_has_equal_exhibits_that_share_their_prompt() -> None:
    prompts = Counter(entry["prompt"] for entry in truth(ROOT / "demo" / "store_room", "names.json").values())
    assert prompts.pop("pitcher") == 2 and set(prompts.values()) == {1} and 9 <= sum(prompts.values()) + 2 <= 12
