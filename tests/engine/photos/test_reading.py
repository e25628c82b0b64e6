"""Photos of a folder are read; unusable files are rejected with a reason."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from engine.errors import Cancelled, PhotoError, SettingsError
from engine.events import Event, Progress, Warned
from engine.photos.pixels import can_read_heic
from engine.photos.reading import read_photos
from engine.photos.settings import PhotoSettings

SMALL = PhotoSettings(min_side=32)


def textured(seed: int, *, height: int = 48, width: int = 64) -> NDArray[np.uint8]:
    """A sharp picture of random squares."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(20, 235, (height // 4, width // 4, 3), dtype=np.uint8)
    return np.repeat(np.repeat(coarse, 4, axis=0), 4, axis=1)


def save(path: Path, pixels: NDArray[np.uint8], **options: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)  # type: ignore[arg-type]


def names(folder: Path, settings: PhotoSettings = SMALL) -> tuple[list[str], dict[str, str]]:
    found = read_photos(folder, settings)
    return [photo.name for photo in found.photos], {photo.name: photo.reason for photo in found.rejected}


def cut_short(path: Path) -> None:
    save(path, textured(9, height=200, width=300), quality=95)
    path.write_bytes(path.read_bytes()[:9000])


def blurred(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    picture = pixels.astype(np.float64)
    for _ in range(40):
        picture = (picture + np.roll(picture, 1, 0) + np.roll(picture, 1, 1) + np.roll(picture, -1, 1)) / 4
    return picture.astype(np.uint8)


FAULTS: dict[str, tuple[Callable[[Path], None], str]] = {
    "cut.jpg": (cut_short, "It is damaged or cut short and cannot be read. Copy it again from the camera."),
    "empty.jpg": (lambda path: path.write_bytes(b"") and None, "It is empty. Copy it again from the camera."),
    "text.png": (
        lambda path: path.write_bytes(b"not a picture") and None,
        "It is not a picture that can be read. Save it as JPEG, PNG or TIFF.",
    ),
    "tiny.png": (
        lambda path: save(path, textured(1, height=16, width=64)),
        "It has only 64 x 16 pixels; at least 32 on each side are needed.",
    ),
    "black.png": (
        lambda path: save(path, np.full((48, 64, 3), 3, np.uint8)),
        "It is black; was the lens cap on?",
    ),
    "white.png": (lambda path: save(path, np.full((48, 64, 3), 254, np.uint8)), "It is white: overexposed throughout."),
    "float.tif": (
        lambda path: Image.fromarray(np.zeros((48, 64), np.float32)).save(path),
        "The picture contains 32-bit floats, whose range is unknown. Save it with 8 or 16 bits.",
    ),
    "twin.png": (lambda path: save(path, textured(0)), "It is the same picture as good0.png."),
    "raw.CR2": (
        lambda path: path.write_bytes(b"II*") and None,
        "Raw camera files are not read; export it as JPEG or TIFF.",
    ),
    "clip.mp4": (lambda path: path.write_bytes(b"x") and None, "Videos are not read; export its frames as JPEG."),
    "old.bmp": (lambda path: save(path, textured(2)), "BMP files are not read; save it as JPEG, PNG or TIFF."),
    "soft.png": (lambda path: save(path, blurred(textured(3))), "It is blurred:"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_an_unusable_file_is_listed_with_its_reason_and_not_fatal(tmp_path: Path, name: str) -> None:
    for seed in range(6):
        save(tmp_path / f"good{seed}.png", textured(seed + 10 * (seed > 0)))
    make, sentence = FAULTS[name]
    make(tmp_path / name)
    used, rejected = names(tmp_path)
    assert used == [f"good{seed}.png" for seed in range(6)]
    assert list(rejected) == [name]
    assert rejected[name].startswith(sentence)


@pytest.mark.skipif(can_read_heic(), reason="pillow-heif is installed")
def test_heic_without_a_reader_says_what_to_install(tmp_path: Path) -> None:
    save(tmp_path / "a.png", textured(0))
    (tmp_path / "b.HEIC").write_bytes(b"x")
    assert names(tmp_path)[1]["b.HEIC"].startswith("HEIC files need the package pillow-heif")


@pytest.mark.skipif(not can_read_heic(), reason="pillow-heif is not installed")
def test_heic_is_read_where_a_reader_is_installed(tmp_path: Path) -> None:
    save(tmp_path / "b.heic", textured(0))
    assert names(tmp_path)[0] == ["b.heic"]


def test_names_with_spaces_non_ascii_letters_and_equal_stems_stay_distinct(tmp_path: Path) -> None:
    wanted = ["a.jpg", "a.png", "Götter und Vasen/Ünïcode 彫刻.jpg", "sub/a.jpg"]
    for seed, name in enumerate(wanted):
        save(tmp_path / name, textured(seed))
    assert sorted(names(tmp_path)[0]) == sorted(wanted)


def test_hidden_files_other_files_and_project_folders_are_skipped(tmp_path: Path) -> None:
    save(tmp_path / "a.png", textured(0))
    save(tmp_path / ".hidden.png", textured(1))
    save(tmp_path / "._a.png", textured(1))
    save(tmp_path / ".thumbs" / "b.png", textured(2))
    save(tmp_path / "output" / "masks" / "c.png", textured(3))
    (tmp_path / "output" / "project.json").write_text("{}")
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / "Thumbs.db").write_bytes(b"x")
    assert names(tmp_path) == (["a.png"], {})


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda path: None, "does not exist. Choose a folder with photos."),
        (lambda path: path.mkdir(), "There are no photos in"),
        (lambda path: path.write_text("x"), "is a file. Choose the folder that contains the photos."),
        (lambda path: (path.mkdir(), (path / "readme.txt").write_text("x")), "There are no photos in"),
        (
            lambda path: (path.mkdir(), (path / "project.json").write_text("{}")),
            "is a Gaussian Heritage project. Choose the folder that contains the photos.",
        ),
        (lambda path: (path.mkdir(), (path / "a.jpg").write_bytes(b"")), "None of the 1 pictures in"),
    ],
    ids=["missing", "empty", "file", "no pictures", "project", "none usable"],
)
def test_a_folder_without_photos_raises_an_error(tmp_path: Path, make: Callable[[Path], object], sentence: str) -> None:
    folder = tmp_path / "photos"
    make(folder)
    with pytest.raises(PhotoError, match=sentence):
        read_photos(folder, SMALL)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="permissions have no effect here")
def test_a_file_without_permission_is_listed(tmp_path: Path) -> None:
    save(tmp_path / "a.png", textured(0))
    save(tmp_path / "b.png", textured(1))
    (tmp_path / "b.png").chmod(0)
    assert list(names(tmp_path)[1]) == ["b.png"]


def test_at_most_a_tenth_of_a_soft_set_is_rejected(tmp_path: Path) -> None:
    for seed in range(11):
        save(tmp_path / f"{seed:02d}.png", textured(seed))
    for seed in range(11, 20):
        save(tmp_path / f"{seed:02d}.png", blurred(textured(seed)))
    used, rejected = names(tmp_path)
    assert len(rejected) == 2
    assert len(used) == 18


def test_few_photos_are_never_rejected_for_blur(tmp_path: Path) -> None:
    for seed in range(3):
        save(tmp_path / f"{seed}.png", textured(seed))
    save(tmp_path / "soft.png", blurred(textured(7)))
    assert len(names(tmp_path)[0]) == 4


def test_progress_and_one_warning_per_rejected_file_are_reported(tmp_path: Path) -> None:
    save(tmp_path / "a.png", textured(0))
    (tmp_path / "b.png").write_bytes(b"")
    events: list[Event] = []
    read_photos(tmp_path, SMALL, emit=events.append)
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions == [0.5, 1.0]
    warnings = [event.message for event in events if isinstance(event, Warned)]
    assert warnings == ["b.png is not used: It is empty. Copy it again from the camera."]


def test_cancel_stops_after_the_current_photo(tmp_path: Path) -> None:
    for seed in range(3):
        save(tmp_path / f"{seed}.png", textured(seed))
    with pytest.raises(Cancelled):
        read_photos(tmp_path, SMALL, should_stop=lambda: True)


def test_settings_out_of_bounds_are_refused() -> None:
    with pytest.raises(SettingsError, match="`PhotoSettings.blur_ratio` must be at least 0 and below 1, got 2"):
        PhotoSettings(blur_ratio=2.0)


@pytest.mark.data
@pytest.mark.parametrize(("scene", "count"), [("sakharov_statue32", 32), ("banana16", 16), ("skull66", 66)])
def test_no_good_photo_of_a_real_set_is_lost(data_folder: Path, scene: str, count: int) -> None:
    found = read_photos(data_folder / scene / "photos")
    assert len(found.photos) == count
    assert found.rejected == ()
