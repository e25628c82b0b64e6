"""A photo list is read from its file as written."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.errors import FormatError
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
    with pytest.raises(FormatError, match="run `reconstruct` again|Use a new folder"):
        read_photo_set(tmp_path / "photos.json")
