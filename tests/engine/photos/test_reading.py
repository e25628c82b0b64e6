"""Photos of a folder are read; unusable files are rejected with a reason."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from engine.core.errors import Cancelled, PhotoError, SettingsError
from engine.core.events import Event, Progress, Warned
from engine.core.visible_text import visible
from engine.photos.inspection import inspect_photos
from engine.photos.reading import file_listing, picture_files, read_photos
from engine.photos.settings import PhotoSettings
from engine.project.folder import stage_key
from engine.scene import read_photo_set, write_photo_set

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
        "It contains 32-bit floats, whose range is unknown. Save it again as RGB with 8 or 16 bits per channel.",
    ),
    "twin.png": (lambda path: save(path, textured(0)), "It is the same picture as good0.png."),
    "raw.CR2": (
        lambda path: path.write_bytes(b"II*") and None,
        "Raw camera files are not read; export it as JPEG or TIFF.",
    ),
    "clip.mp4": (
        lambda path: path.write_bytes(b"x") and None,
        "Videos beside photos are not read; reconstruct the video itself",
    ),
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


POSIX_FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "dangling.jpg": (
        lambda path: path.symlink_to("gone.jpg"),
        "It is a link to a file that does not exist. Delete it or mend it.",
    ),
    "loop.jpg": (lambda path: path.symlink_to("loop.jpg"), "It cannot be read: Too many levels of symbolic links."),
    "pipe.jpg": (lambda path: os.mkfifo(path), "It is not a file: it is a pipe or a device. Delete it."),
    "device.png": (lambda path: path.symlink_to("/dev/zero"), "It is not a file: it is a pipe or a device. Delete it."),
    "folder.jpg": (lambda path: path.mkdir(), "It is a folder."),
    "link.jpg": (
        lambda path: ((path.parent / "hidden" / ".x").mkdir(parents=True), path.symlink_to("hidden")),
        "It is a folder that cannot be read, or a link to a folder, which is not followed.",
    ),
    "escape\x1b[31m\n.jpg": (
        lambda path: save(path, textured(20)),
        "Its name has control characters. Rename it.",
    ),
    "caf\udce9.jpg": (lambda path: save_as_bytes(path, 21), "Its name has bytes that are not UTF-8. Rename it."),
    "sub\udcff/a.jpg": (lambda path: save_as_bytes(path, 22), "Its name has bytes that are not UTF-8. Rename it."),
}


def save_as_bytes(path: Path, seed: int) -> None:
    """Save a photo whose name is not UTF-8."""
    path.parent.mkdir(exist_ok=True)
    save(path.parent.parent / "plain.jpg", textured(seed))
    os.rename(path.parent.parent / "plain.jpg", os.fsencode(path))


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such files")
@pytest.mark.parametrize("name", POSIX_FAULTS, ids=lambda name: visible(name))
def test_special_file_and_name_reject_themselves_and_are_shown_printable(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "photos"
    for seed in range(2):
        save(folder / f"good{seed}.png", textured(seed))
    make, sentence = POSIX_FAULTS[name]
    try:
        make(folder / name)
    except OSError:
        pytest.skip("this file system does not admit the name")
    events: list[Event] = []
    found = read_photos(folder, SMALL, emit=events.append)
    assert [photo.name for photo in found.photos] == ["good0.png", "good1.png"]
    (rejected,) = found.rejected
    assert (rejected.name, rejected.reason.startswith(sentence)) == (visible(name), True), rejected
    (warning,) = [event.message for event in events if isinstance(event, Warned)]
    assert warning.isprintable() and warning.encode("utf-8")
    # What a project stores about its photos.
    write_photo_set(tmp_path / "photos.json", found)
    assert read_photo_set(tmp_path / "photos.json") == found
    assert len(inspect_photos(found)) == 2


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such files")
def test_plan_and_the_listing_of_a_project_agree_on_special_files(tmp_path: Path) -> None:
    """``plan`` succeeded where ``reconstruct`` ended in an error."""
    folder = tmp_path / "photos"
    save(folder / "good.png", textured(0))
    for name, (make, _) in POSIX_FAULTS.items():
        with contextlib.suppress(OSError):
            make(folder / name)
    listing = file_listing(folder, picture_files(folder))
    assert len(listing) == len(read_photos(folder, SMALL).rejected) + 1 > 6
    assert stage_key(listing) == stage_key(file_listing(folder, picture_files(folder)))
    good = (folder / "good.png").stat()
    assert ["good.png", good.st_size, good.st_mtime_ns] in listing
    assert ["dangling.jpg", None, None] in listing


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
@pytest.mark.parametrize("through_link", [False, True])
def test_folder_whose_name_is_not_utf8_is_one_clear_sentence(tmp_path: Path, through_link: bool) -> None:
    folder = tmp_path / "caf\udce9"
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system does not admit the name")
    save_as_bytes(folder / "a.jpg", 0)
    if through_link:
        (tmp_path / "link").symlink_to(folder)
        folder = tmp_path / "link"
    with pytest.raises(PhotoError, match=r"caf\\udce9 has bytes that are not UTF-8\. Rename the folder\.$"):
        read_photos(folder, SMALL)


def test_folder_named_like_a_photo_is_a_folder_of_photos(tmp_path: Path) -> None:
    save(tmp_path / "vase.jpg" / "a.png", textured(0))
    assert names(tmp_path) == (["vase.jpg/a.png"], {})


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="permissions have no effect here")
def test_folder_without_permission_is_listed(tmp_path: Path) -> None:
    save(tmp_path / "a.png", textured(0))
    save(tmp_path / "closed" / "b.png", textured(1))
    (tmp_path / "closed").chmod(0)
    try:
        used, rejected = names(tmp_path)
    finally:
        (tmp_path / "closed").chmod(0o700)
    assert used == ["a.png"] and rejected["closed"].startswith("It is a folder that cannot be read")


def test_error_of_any_type_while_decoding_rejects_its_photo_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed in range(2):
        save(tmp_path / f"{seed}.png", textured(seed, height=48 + 8 * seed))

    def fail(image: Image.Image) -> int:
        if image.height == 48:
            raise UnboundLocalError("a decoder's mistake")
        return 1

    monkeypatch.setattr("engine.photos.pixels.orientation_of", fail)
    used, rejected = names(tmp_path)
    assert used == ["1.png"] and rejected["0.png"].startswith("It is damaged or cut short")


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
