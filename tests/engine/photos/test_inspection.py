"""Statistics of photos: texture."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import Cancelled, FormatError, PhotoError
from engine.photos.inspection import PhotoStatistics, inspect_photos, read_photo_statistics
from engine.scene.photo import Photo, PhotoSet


def photo_set(folder: Path, pictures: dict[str, Image.Image], exif: Image.Exif | None = None) -> PhotoSet:
    for name, picture in pictures.items():
        picture.save(folder / name, exif=Image.Exif() if exif is None else exif)
    return PhotoSet(folder, tuple(Photo(name, *p.size, None, "") for name, p in pictures.items()), ())


def gray(value: int) -> Image.Image:
    return Image.new("RGB", (400, 300), (value, value, value))


def test_texture_distinguishes_a_plain_wall_from_a_pattern(tmp_path: Path) -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 255, (300, 400, 3), dtype=np.uint8))
    plain, pattern = inspect_photos(photo_set(tmp_path, {"a.png": gray(90), "b.png": noise}))
    assert plain.texture == 0.0 < 0.5 < pattern.texture


def test_statistics_are_read_from_their_file(tmp_path: Path) -> None:
    statistics = [PhotoStatistics("a.jpg", 0.5), PhotoStatistics("b.jpg", 0.25)]
    (tmp_path / "looks.json").write_text(json.dumps([asdict(photo) for photo in statistics]))
    assert read_photo_statistics(tmp_path / "looks.json") == statistics
    (tmp_path / "looks.json").write_text('[{"name": "a"}]')
    with pytest.raises(FormatError, match="looks.json"):
        read_photo_statistics(tmp_path / "looks.json")


@pytest.mark.parametrize(
    "damage",
    [
        "",
        "{",
        "5",
        '[{"name": "a", "texture": 1e999}]',
        '[{"name": "a", "texture": 1e300}]',
        '[{"name": "a", "texture": 2}]',
        '[{"name": "a", "texture": "plain"}]',
        "[" * 100_000,
        "\xff",
    ],
    ids=["empty", "cut", "number", "infinite", "large", "share", "text", "nested", "latin"],
)
def test_damaged_statistics_end_in_one_sentence(tmp_path: Path, damage: str) -> None:
    (tmp_path / "looks.json").write_bytes(damage.encode("latin-1"))
    with pytest.raises(FormatError, match=r"looks\.json cannot be read: .*Delete it and run again\.$"):
        read_photo_statistics(tmp_path / "looks.json")


def test_missing_photo_and_cancel_raise(tmp_path: Path) -> None:
    photos = photo_set(tmp_path, {"a.png": gray(90), "b.png": gray(91)})
    with pytest.raises(Cancelled):
        inspect_photos(photos, should_stop=lambda: True)
    (tmp_path / "a.png").unlink()
    with pytest.raises(PhotoError, match=r"a\.png"):
        inspect_photos(photos)
