"""A photo list is read from its file as written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from engine.core.errors import FormatError
from engine.scene.photo import Photo, PhotoSet, RejectedPhoto
from engine.scene.photo_storage import read_photo_set, write_photo_set


def test_a_photo_set_is_read_as_written(tmp_path: Path) -> None:
    photo_set = PhotoSet(
        tmp_path / "Fotos ü",
        (Photo("a b/ü.jpg", 4000, 3000, 3210.123456789, "ab" * 32), Photo("c.png", 1, 2, None, "0" * 64)),
        (RejectedPhoto("d.jpg", "It is empty."),),
    )
    write_photo_set(tmp_path / "photos.json", photo_set)
    assert read_photo_set(tmp_path / "photos.json") == photo_set


@pytest.mark.parametrize("text", ["", "[]", '{"version": 1}', '{"version": 99}', "{"])
def test_a_file_of_another_format_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "photos.json").write_text(text)
    with pytest.raises(FormatError, match="run `reconstruct` again|Update Gaussian Heritage"):
        read_photo_set(tmp_path / "photos.json")


def photo(**changes: object) -> dict[str, object]:
    entry: dict[str, object] = {"name": "a.jpg", "width": 40, "height": 30, "focal_px": 35.5, "sha256": "0" * 64}
    return {**entry, **changes}


@pytest.mark.parametrize(
    ("entry", "problem"),
    [
        (photo(width=0), "it cannot have 0 x 30 pixels"),
        (photo(height=-1), "it cannot have 40 x -1 pixels"),
        (photo(width=10**7), "it cannot have 10000000 x 30 pixels"),
        (photo(width=True), "must be a whole number"),
        (photo(width="40"), "must be a whole number"),
        (photo(focal_px=0), "focal length must be above 0"),
        (photo(focal_px=-1.0), "focal length must be above 0"),
        (photo(focal_px="long"), "must be a finite number or null"),
        (photo(name="../a.jpg"), "is not the name of a photo"),
        (photo(name=None), "must be a text"),
        (photo(sha256=1), "must be a text"),
        (photo(mask=[]), "must be a text or null"),
        (photo(mask="a\0b"), "a path has a null character"),
        ({"name": "a.jpg"}, "is missing"),
    ],
)
def test_a_photo_that_cannot_exist_is_refused(tmp_path: Path, entry: dict[str, object], problem: str) -> None:
    file = tmp_path / "photos.json"
    data = {"version": 1, "folder": "/photos", "photos": [photo()], "rejected": []}
    file.write_text(json.dumps(data), encoding="utf-8")
    assert len(read_photo_set(file).photos) == 1
    file.write_text(json.dumps({**data, "photos": [entry]}), encoding="utf-8")
    with pytest.raises(FormatError) as caught:
        read_photo_set(file)
    assert problem in str(caught.value) and "run `reconstruct` again" in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"\xff\xfe", b"[" * 100_000, b'{"version": NaN}', b'{"version": 1' + b"0" * 5000 + b"}", None]
)
def test_a_damaged_file_is_one_sentence(tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "photos.json").write_bytes(content)
    with pytest.raises(FormatError, match=r"photos\.json cannot be read"):
        read_photo_set(tmp_path / "photos.json")
