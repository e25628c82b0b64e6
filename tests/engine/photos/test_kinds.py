"""What a file is, its content says, not its name."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from engine.photos.kinds import kind_of_file
from engine.photos.loading import load_pixels
from engine.photos.reading import read_photos
from engine.photos.video import is_video

from .hostile import tiff
from .test_heic import write_heic
from .test_reading import SMALL, names, save, textured


def write_video(path: Path) -> None:
    written = path.with_name("written.mp4")
    writer = cv2.VideoWriter(str(written), cv2.VideoWriter.fourcc(*"mp4v"), 10, (64, 48))
    for seed in range(3):
        writer.write(textured(seed))
    writer.release()
    written.rename(path)


@pytest.mark.parametrize("encoded", ["JPEG", "PNG", "TIFF", "WEBP", "HEIF"])
@pytest.mark.parametrize(
    "name", ["a.HEIC", "a.jpg", "a.png", "a.tif", "a.webp", "a.CR2", "a.mp4", "a.bmp", "a", "a.jpg.download"]
)
def test_a_photo_under_any_name_is_read(tmp_path: Path, encoded: str, name: str) -> None:
    Image.fromarray(textured(0)).save(tmp_path / name, format=encoded, quality=95)
    assert names(tmp_path) == ([name], {})
    assert np.abs(load_pixels(tmp_path / name).astype(int) - textured(0)).mean() < 20


@pytest.mark.parametrize(
    ("content", "kind", "sentence"),
    [
        (b"GIF89a" + bytes(60), "GIF", "GIF files are not read; save it as JPEG, PNG or TIFF."),
        (b"\0\0\0\x1cftypavif\0\0\0\0avifmif1miaf" + bytes(40), "AVIF", "AVIF files are not read"),
        (b"\0\0\0\x1cftypmif1\0\0\0\0mif1avifmiaf" + bytes(40), "AVIF", "AVIF files are not read"),
        (b"\0\0\0\x18ftypcrx \0\0\0\1crx isom" + bytes(40), "raw", "Raw camera files are not read"),
        (b"II*\0\x10\0\0\0CR\2\0" + bytes(60), "raw", "Raw camera files are not read"),
        (b"FUJIFILMCCD-RAW 0201" + bytes(60), "raw", "Raw camera files are not read"),
        (tiff([(50706, 1, 4, 0x00000401), (262, 3, 1, 2)]), "raw", "Raw camera files are not read"),
        (tiff([(262, 3, 1, 32803)]), "raw", "Raw camera files are not read"),
        (b"\0\0\0\x14ftypqt  \0\0\0\0qt  " + bytes(40), "video", "Videos beside photos are not read"),
        (b"RIFF\0\1\0\0AVI LIST" + bytes(40), "video", "Videos beside photos are not read"),
        (b"\x1a\x45\xdf\xa3" + bytes(60), "video", "Videos beside photos are not read"),
        (b"8BPS\0\1" + bytes(60), "PSD", "PSD files are not read"),
        (b"a text" + bytes(60), None, "It is not a picture that can be read. Save it as JPEG, PNG or TIFF."),
    ],
)
def test_other_content_under_the_name_of_a_photo_is_named(
    tmp_path: Path, content: bytes, kind: str | None, sentence: str
) -> None:
    save(tmp_path / "good.png", textured(0))
    (tmp_path / "other.jpg").write_bytes(content)
    assert kind_of_file(tmp_path / "other.jpg") == kind
    used, rejected = names(tmp_path)
    assert used == ["good.png"] and rejected["other.jpg"].startswith(sentence)


@pytest.mark.parametrize("still", ["IMG_1.HEIC", "img_1.jpg"])
def test_the_moving_part_of_a_live_photo_is_no_second_input(tmp_path: Path, still: str) -> None:
    write_heic(tmp_path / still, textured(0))
    write_video(tmp_path / "IMG_1.MOV")
    write_video(tmp_path / "IMG_2.MOV")
    used, rejected = names(tmp_path)
    assert used == [still]
    assert list(rejected) == ["IMG_2.MOV"]


def test_a_video_is_known_by_its_content(tmp_path: Path) -> None:
    write_video(tmp_path / "clip.bin")
    save(tmp_path / "a.png", textured(0))
    (tmp_path / "a.png").rename(tmp_path / "photo.mp4")
    assert is_video(tmp_path / "clip.bin")
    assert not is_video(tmp_path / "photo.mp4")
    assert not is_video(tmp_path)


def test_other_files_are_skipped(tmp_path: Path) -> None:
    save(tmp_path / "a.png", textured(0))
    for name, content in (("notes", b"hello"), ("model.bin", bytes(200)), ("a.xmp", b"<x:xmpmeta/>"), ("empty", b"")):
        (tmp_path / name).write_bytes(content)
    found = read_photos(tmp_path, SMALL)
    assert [photo.name for photo in found.photos] == ["a.png"] and found.rejected == ()
