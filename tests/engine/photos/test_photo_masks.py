"""Masks and transparency decide which pixels of a photo are valid; masks that do not match raise errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from engine.core.errors import Cancelled, PhotoError
from engine.core.events import Event, Warned, ignore_events
from engine.photos.loading import load_valid, load_with_valid
from engine.photos.reading import picture_files, read_photos
from engine.scene.photo import PhotoSet
from engine.scene.photo_storage import read_photo_set, write_photo_set

from .test_reading import SMALL, save, textured

HEIGHT, WIDTH = 48, 64


def left_half() -> NDArray[np.bool_]:
    """Return a mask whose left half is valid."""
    valid = np.zeros((HEIGHT, WIDTH), bool)
    valid[:, : WIDTH // 2] = True
    return valid


def scene(folder: Path, *masked: str) -> tuple[Path, Path]:
    """Write three photos, and masks that keep the left half of the photos `masked`."""
    photos, masks = folder / "photos", folder / "masks"
    masks.mkdir(parents=True)
    for index, name in enumerate(("a.jpg", "b.jpg", "in/c.png")):
        save(photos / name, textured(index))
    for name in masked:
        save(masks / f"{name}.png", left_half().astype(np.uint8) * 255)
    return photos, masks


def read(photos: Path, masks: Path, events: list[Event] | None = None) -> PhotoSet:
    return read_photos(photos, SMALL, masks=masks, emit=ignore_events if events is None else events.append)


def test_masks_are_found_by_the_photos_names_and_others_are_used_whole_with_a_warning(tmp_path: Path) -> None:
    events: list[Event] = []
    found = read(*scene(tmp_path, "a.jpg", "in/c.png"), events)
    assert sorted(found.mask_files) == ["a.jpg", "in/c.png"]
    (warning,) = [event.message for event in events if isinstance(event, Warned)]
    assert warning == f"1 of 3 photos have no mask in {tmp_path / 'masks'} and are used whole: b.jpg."
    assert [len(photo.hashes) for photo in found.photos] == [3, 2, 3]
    write_photo_set(tmp_path / "photos.json", found)
    assert read_photo_set(tmp_path / "photos.json") == found


@pytest.mark.parametrize("names", [("a.png", "c.png"), ("A_mask.PNG", "c-mask.png"), ("deep/a.jpg.png", "in/c.png")])
def test_masks_are_found_under_other_usual_names(tmp_path: Path, names: tuple[str, str]) -> None:
    photos, masks = scene(tmp_path)
    for name in names:
        save(masks / name, left_half().astype(np.uint8) * 255)
    assert sorted(read(photos, masks).mask_files) == ["a.jpg", "in/c.png"]


def test_transparent_pixels_over_black_are_valid_and_empty(tmp_path: Path) -> None:
    alpha = np.full((HEIGHT, WIDTH), 255, np.uint8)
    alpha[:, :20], alpha[:, 20:24] = 0, 128
    save(tmp_path / "a.png", np.dstack([np.full((HEIGHT, WIDTH, 3), 200, np.uint8), alpha]))
    pixels, valid = load_with_valid(tmp_path / "a.png", None, over_black=True)
    # A margin of a pixel and the half transparent columns are not known.
    assert valid is not None and np.flatnonzero(~valid[0]).tolist() == [19, 20, 21, 22, 23]
    assert not pixels[:, :20].any() and (pixels[:, 24:] == 200).all()
    # Half of 200, rounded twice.
    assert abs(pixels[:, 20:24].astype(int) - 100).max() <= 1


@pytest.mark.parametrize(
    "name", ["a.jpg.png", "a.png", "A.PNG", "a_mask.png", "a.mask.png", "a.jpg.mask.png", "masks of/a.JPG.png"]
)
def test_masks_may_be_named_as_other_programs_name_them(tmp_path: Path, name: str) -> None:
    photos, masks = scene(tmp_path, "in/c.png")
    save(masks / name, left_half().astype(np.uint8) * 255)
    assert read(photos, masks).mask_files == {"a.jpg": masks / name, "in/c.png": masks / "in" / "c.png.png"}


def test_masks_that_may_be_of_several_photos_are_refused(tmp_path: Path) -> None:
    photos, masks = scene(tmp_path, "b.jpg")
    save(photos / "in" / "a.jpg", textured(5))
    save(masks / "c.png.png", left_half().astype(np.uint8) * 255)
    save(masks / "of" / "a.jpg.png", left_half().astype(np.uint8) * 255)
    assert "in/c.png" in read_photos(photos, SMALL, masks=masks).mask_files
    save(photos / "out" / "a.jpg", textured(6))
    (photos / "a.jpg").unlink()
    with pytest.raises(
        PhotoError, match=r"which photos they are of: of/a\.jpg may be in/a\.jpg or out/a\.jpg\. Give each"
    ):
        read(photos, masks)


def test_two_masks_of_one_photo_are_refused(tmp_path: Path) -> None:
    photos, masks = scene(tmp_path, "b.jpg")
    for name in ("a.png", "a_mask.png"):
        save(masks / name, left_half().astype(np.uint8) * 255)
    with pytest.raises(PhotoError, match=r"are masks of one photo\. Delete one"):
        read(photos, masks)


def test_an_edited_mask_has_another_hash(tmp_path: Path) -> None:
    photos, masks = scene(tmp_path, "a.jpg")
    before = read(photos, masks).photos[0].hashes
    save(masks / "a.jpg.png", (~left_half()).astype(np.uint8) * 255)
    assert read(photos, masks).photos[0].hashes != before


def test_masks_inside_the_photo_folder_are_not_taken_for_photos(tmp_path: Path) -> None:
    photos, masks = scene(tmp_path, "a.jpg")
    inside = masks.rename(photos / "masks")
    assert [photo.name for photo in read(photos, inside).photos] == ["a.jpg", "b.jpg", "in/c.png"]
    assert len(picture_files(photos)) == 4


@pytest.mark.parametrize("white", [1, 255])
def test_only_black_pixels_are_excluded_in_every_mask_format(tmp_path: Path, white: int) -> None:
    save(tmp_path / "a.png", textured(0))
    gray = left_half().astype(np.uint8) * white
    kinds = [
        Image.fromarray(gray),
        Image.fromarray(np.dstack([gray * 0, gray, gray * 0])),
        Image.fromarray(left_half()),
    ]
    kinds += [Image.fromarray(gray.astype(np.uint16) * 256), Image.fromarray(gray).convert("P")]
    for index, picture in enumerate(kinds):
        picture.save(tmp_path / f"{index}.png")
        valid = load_valid(tmp_path / "a.png", tmp_path / f"{index}.png")
        assert valid is not None and np.array_equal(valid, left_half()), picture.mode


def test_excluded_pixels_do_not_contribute_to_valid_pixels_of_a_reduced_picture(tmp_path: Path) -> None:
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[20:30, 33:40] = 0
    save(tmp_path / "m.png", mask)
    shown = []
    for value in (0, 255):
        pixels = textured(0)
        pixels[mask == 0] = value
        save(tmp_path / "a.png", pixels)
        smaller, valid = load_with_valid(tmp_path / "a.png", tmp_path / "m.png", max_side=20)
        assert smaller.shape == (15, 20, 3) and valid is not None and 0.8 < valid.mean() < 0.95
        shown.append(smaller[valid])
    assert np.array_equal(*shown)


@pytest.mark.parametrize("suffix", ["png", "tif", "webp"])
def test_transparent_pixels_are_not_valid(tmp_path: Path, suffix: str) -> None:
    alpha = np.where(left_half(), 255, 40).astype(np.uint8)
    save(tmp_path / f"a.{suffix}", np.dstack([textured(0), alpha]), **({"lossless": True} if suffix == "webp" else {}))
    valid = load_valid(tmp_path / f"a.{suffix}", None)
    assert valid is not None and np.array_equal(valid, left_half())
    save(tmp_path / f"b.{suffix}", np.dstack([textured(0), np.full_like(alpha, 255)]))
    assert load_valid(tmp_path / f"b.{suffix}", None) is None
    assert load_valid(tmp_path / f"b.{suffix}", tmp_path / f"b.{suffix}") is None


def test_a_mask_may_be_upright_or_stored_like_a_photo_with_exif_rotation(tmp_path: Path) -> None:
    turned = Image.Exif()
    turned[0x0112] = 6
    Image.fromarray(textured(0)).save(tmp_path / "a.jpg", exif=turned)
    upright = np.rot90(left_half(), -1)
    save(tmp_path / "upright.png", upright.astype(np.uint8))
    save(tmp_path / "stored.png", left_half().astype(np.uint8))
    for name in ("upright.png", "stored.png"):
        pixels, valid = load_with_valid(tmp_path / "a.jpg", tmp_path / name)
        assert pixels.shape[:2] == (WIDTH, HEIGHT)
        assert valid is not None and np.array_equal(valid, upright), name


def test_masks_that_do_not_match_raise_errors(tmp_path: Path) -> None:
    photos, masks = scene(tmp_path)
    with pytest.raises(PhotoError, match=r"does not exist\. Choose the folder"):
        read(photos, tmp_path / "elsewhere")
    with pytest.raises(PhotoError, match=r"No file in .* is a mask of one of the photos.*: a\.jpg\.png\."):
        read(photos, masks)
    file = masks / "b.jpg.png"
    save(file, np.full((HEIGHT, WIDTH + 1), 255, np.uint8))
    with pytest.raises(PhotoError, match=r"b\.jpg\.png has 65 x 48 pixels, its photo b\.jpg 64 x 48"):
        read(photos, masks)
    save(file, np.zeros((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(PhotoError, match=r"excludes every pixel of b\.jpg"):
        read(photos, masks)
    file.write_bytes(b"no picture")
    with pytest.raises(PhotoError, match=r"The mask .*b\.jpg\.png cannot be read"):
        read(photos, masks)


def test_reading_masks_can_be_cancelled(tmp_path: Path) -> None:
    photos, masks = scene(tmp_path, "a.jpg")
    # Once per photo while photos are read, then per mask.
    answers = iter([False] * 3 + [True])
    with pytest.raises(Cancelled, match="masks"):
        read_photos(photos, SMALL, masks=masks, should_stop=lambda: next(answers))


def test_photo_whose_mask_can_have_no_name_is_told_so(tmp_path: Path) -> None:
    photos, masks = scene(tmp_path, "a.jpg")
    save(photos / ("花" * 83 + "ab.jpg"), textured(5))
    with pytest.raises(PhotoError, match=r"ab\.jpg is too long: .* 259 bytes, .* Give the photo a shorter name\.$"):
        read(photos, masks)
