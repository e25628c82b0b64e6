"""A shot in other pixels counts once; shots that are nearly the same are all kept."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from engine.core.arrays import Pixels
from engine.core.events import Event, Warned
from engine.photos.reading import read_photos
from engine.photos.settings import PhotoSettings
from engine.training.views import is_held_out
from tests.conftest import ROOT

from .test_reading import names

MUSEUM = sorted((ROOT / "demo" / "museum_room" / "photos").glob("*.jpg"))
# Blur is another matter: a small copy is softer or sharper than its original.
ANY_SHARPNESS = PhotoSettings(blur_ratio=0.0)


def photo(number: int, side: int = 640) -> Pixels:
    with Image.open(MUSEUM[number]) as picture:
        picture.thumbnail((side, side))
        return np.asarray(picture.convert("RGB"))


def save(path: Path, pixels: Pixels, **options: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)  # type: ignore[arg-type]


def reduced(pixels: Pixels, scale: float, interpolation: int = cv2.INTER_AREA) -> Pixels:
    size = round(pixels.shape[1] * scale), round(pixels.shape[0] * scale)
    return np.asarray(cv2.resize(pixels, size, interpolation=interpolation))


def recoloured(pixels: Pixels) -> Pixels:
    values = (pixels / 255.0) ** 0.94
    gray = values.mean(axis=2, keepdims=True)
    values = (gray + 1.12 * (values - gray)) * np.array([1.04, 1.0, 0.96])
    return np.rint(255.0 * values.clip(0.0, 1.0)).astype(np.uint8)


def moved(pixels: Pixels, x: float, y: float) -> Pixels:
    size = pixels.shape[1], pixels.shape[0]
    shift = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    return np.asarray(cv2.warpAffine(pixels, shift, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT))


COPIES: dict[str, Callable[[Pixels], Pixels]] = {
    "encoded again": lambda pixels: pixels,
    "recoloured": recoloured,
    "half": lambda pixels: reduced(pixels, 0.5),
    "third, recoloured": lambda pixels: recoloured(reduced(pixels, 1 / 3, cv2.INTER_LINEAR)),
    "reduced by skipping pixels": lambda pixels: np.ascontiguousarray(pixels[::2, ::2]),
    "rotated": lambda pixels: np.ascontiguousarray(np.rot90(reduced(pixels, 0.7))),
}


@pytest.mark.parametrize("kind", COPIES)
def test_copy_under_another_name_is_left_out_and_the_largest_kept(tmp_path: Path, kind: str) -> None:
    for number in range(2):
        save(tmp_path / f"view_{number}.jpg", photo(number), quality=93)
        save(tmp_path / "messenger" / f"IMG-WA{number}7.jpg", COPIES[kind](photo(number)), quality=50)
    used, rejected = names(tmp_path, ANY_SHARPNESS)
    assert used == ["view_0.jpg", "view_1.jpg"]
    for number in range(2):
        assert f"the same shot as view_{number}.jpg" in rejected[f"messenger/IMG-WA{number}7.jpg"]


OTHER_SHOTS: dict[str, Callable[[Pixels], Pixels]] = {
    "camera moved by half a pixel": lambda pixels: moved(pixels, 0.5, 0.25),
    "camera moved by four pixels": lambda pixels: moved(pixels, 4.0, 1.0),
    "tripod, other noise": lambda pixels: np.clip(
        pixels + np.random.default_rng(1).normal(0.0, 3.0, pixels.shape), 0, 255
    ).astype(np.uint8),
    "only a thing in the middle moved": lambda pixels: _with_middle(pixels, moved(pixels, 3.0, 0.0)),
}


def _with_middle(pixels: Pixels, other: Pixels) -> Pixels:
    result = pixels.copy()
    middle = np.s_[len(pixels) // 3 : 2 * len(pixels) // 3, pixels.shape[1] // 3 : 2 * pixels.shape[1] // 3]
    result[middle] = other[middle]
    return result


@pytest.mark.parametrize("kind", OTHER_SHOTS)
def test_other_shot_of_the_same_view_is_kept(tmp_path: Path, kind: str) -> None:
    # Cameras also vary their quality from shot to shot; a tripod is known by the quality being the same.
    quality = 93 if "tripod" in kind else 80
    save(tmp_path / "IMG_0001.jpg", photo(0), quality=93)
    save(tmp_path / "IMG_0002.jpg", OTHER_SHOTS[kind](photo(0)), quality=quality)
    assert names(tmp_path, ANY_SHARPNESS)[0] == ["IMG_0001.jpg", "IMG_0002.jpg"]


def test_all_photos_of_the_museum_room_are_kept() -> None:
    assert len(read_photos(MUSEUM[0].parent).photos) == len(list(MUSEUM[0].parent.rglob("*.jpg")))


def test_photos_of_another_time_are_kept(tmp_path: Path) -> None:
    for number, time in enumerate(("2024:05:17 10:31:02", "2024:05:17 10:31:03")):
        exif = Image.Exif()
        exif[0x8769] = {0x9003: time}
        save(tmp_path / f"{number}.jpg", photo(0), quality=(93, 70)[number], exif=exif)
    assert names(tmp_path, ANY_SHARPNESS)[0] == ["0.jpg", "1.jpg"]


def test_photos_with_one_name_in_two_folders_of_a_camera_are_kept(tmp_path: Path) -> None:
    save(tmp_path / "100CANON" / "IMG_0001.jpg", photo(0), quality=93)
    save(tmp_path / "101CANON" / "IMG_0001.jpg", photo(1), quality=93)
    assert len(names(tmp_path, ANY_SHARPNESS)[0]) == 2


def test_root_of_a_data_set_gives_each_shot_once_and_says_so(tmp_path: Path) -> None:
    """Reduced copies and masks were taken for photos: test photos then had their twin in training."""
    rows, columns = np.mgrid[0:480, 0:640]
    for number in range(3):
        pixels = photo(number)
        rows, columns = np.mgrid[0 : pixels.shape[0], 0 : pixels.shape[1]]
        save(tmp_path / "images" / f"frame_{number}.jpg", pixels, quality=93)
        save(tmp_path / "images_2" / f"frame_{number}.jpg", reduced(pixels, 0.5), quality=90)
        save(tmp_path / "images_4" / f"frame_{number}.png", reduced(pixels, 0.35))
        save(tmp_path / "@eaDir" / f"frame_{number}.jpg" / "SYNOPHOTO_THUMB_XL.jpg", reduced(pixels, 0.6), quality=80)
        save(tmp_path / ".thumbnails" / f"{number}.png", reduced(pixels, 0.4))
        disc = np.hypot(rows - pixels.shape[0] / 2, columns - pixels.shape[1] / 2) < 90 + 10 * number
        encoded = io.BytesIO()
        Image.fromarray((disc * 255).astype(np.uint8)).save(encoded, "JPEG", quality=75)
        (tmp_path / "masks").mkdir(exist_ok=True)
        (tmp_path / "masks" / f"frame_{number}.jpg").write_bytes(encoded.getvalue())
    events: list[Event] = []
    found = read_photos(tmp_path, ANY_SHARPNESS, emit=events.append)
    assert [one.name for one in found.photos] == [f"images/frame_{number}.jpg" for number in range(3)]
    said = [event.message for event in events if isinstance(event, Warned)]
    assert said[0].startswith("3 pictures in masks look like masks") and "--photo-masks" in said[0]
    assert "(3 in images_2, 3 in images_4)" in said[1]
    assert not any("eaDir" in sentence or "thumbnails" in sentence for sentence in said)
    with_masks = read_photos(tmp_path, ANY_SHARPNESS, masks=tmp_path / "masks")
    assert [Path(one.mask or "").name for one in with_masks.photos] == [f"frame_{number}.jpg" for number in range(3)]


def test_no_test_photo_has_a_copy_among_the_training_photos(tmp_path: Path) -> None:
    """Test photos had their reduced copies in training, so the test PSNR read 26.3 dB instead of 20.4."""
    for number in range(8):
        save(tmp_path / "images" / f"frame_{number}.jpg", photo(number), quality=93)
        save(tmp_path / "images_2" / f"frame_{number}.jpg", reduced(photo(number), 0.5), quality=90)
        # Under other names, and in another order than the originals.
        save(tmp_path / f"IMG-WA{7 - number}.jpg", recoloured(reduced(photo(number), 0.7)), quality=60)
    used = [one.name for one in read_photos(tmp_path, ANY_SHARPNESS).photos]
    shots = [7 - int(name[6]) if name.startswith("IMG-WA") else int(name[-5]) for name in used]
    assert set(shots) == set(range(8))
    for every in (2, 3, 8):
        test = {shot for index, shot in enumerate(shots) if is_held_out(index, every)}
        assert test and not test & {shot for index, shot in enumerate(shots) if not is_held_out(index, every)}


def test_two_valued_picture_is_a_mask_whatever_its_name_is(tmp_path: Path) -> None:
    pixels = photo(0)
    save(tmp_path / "a.jpg", pixels, quality=93)
    half = np.zeros(pixels.shape[:2], np.uint8)
    half[:, 200:] = 255
    save(tmp_path / "b.png", half)
    used, rejected = names(tmp_path, ANY_SHARPNESS)
    assert used == ["a.jpg"]
    assert rejected["b.png"] == "It looks like a mask, not like a photo."


def test_cut_out_on_white_is_a_photo(tmp_path: Path) -> None:
    pixels = photo(0)
    cut_out = np.full_like(pixels, 255)
    cut_out[200:240, 300:350] = pixels[200:240, 300:350]
    save(tmp_path / "masked" / "a.png", cut_out)
    assert names(tmp_path, ANY_SHARPNESS)[0] == ["masked/a.png"]


def test_the_copy_that_knows_its_focal_length_is_kept(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x8769] = {0xA405: 28}
    pixels = photo(0)
    save(tmp_path / "a.png", pixels)
    save(tmp_path / "b.png", pixels, exif=exif)
    used, rejected = names(tmp_path, ANY_SHARPNESS)
    assert used == ["b.png"] and rejected["a.png"] == "It is the same picture as b.png."
