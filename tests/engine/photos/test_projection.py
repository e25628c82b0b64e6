"""Panoramas, fisheye pictures and screenshots are named before they are taken for ordinary views."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from engine.core.errors import PhotoError
from engine.photos.heic import can_read_heic
from engine.photos.reading import read_photos
from engine.photos.settings import PhotoSettings
from tests.conftest import ROOT

from .test_reading import SMALL, names, save, textured

can_read_heic()
MUSEUM = ROOT / "demo" / "museum_room" / "photos"
_XMP = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" {}</rdf:RDF></x:xmpmeta>'
)
PANORAMA = "It is a 360 degree panorama, which cannot be used as a photo. Cut it into ordinary views first."


def panorama(seed: int, *, height: int = 128) -> NDArray[np.uint8]:
    """Return all that a camera in a room of coloured tiles sees, in an equirectangular picture."""
    rng = np.random.default_rng(seed)
    colours = rng.integers(20, 235, (3, 12, 12, 3))
    down, across = (np.arange(height) + 0.5) / height * np.pi, (np.arange(2 * height) + 0.5) / height * np.pi
    theta, phi = np.meshgrid(down, across, indexing="ij")
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    rays = rays @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    face = np.abs(rays).argmax(axis=-1)
    hits = rays / np.abs(rays).max(axis=-1, keepdims=True)
    first, second = (np.take_along_axis(hits, ((face + step) % 3)[..., None], -1)[..., 0] for step in (1, 2))
    tiles = [np.clip((one * 0.5 + 0.5) * 12, 0, 11).astype(int) for one in (first, second)]
    return colours[face, tiles[0], tiles[1]].astype(np.uint8)


def fisheye(photo: NDArray[np.uint8], seed: int, *, diameter: float = 0.96) -> NDArray[np.uint8]:
    """Return a photo as a round picture with black corners, with the noise of a sensor."""
    height, width = 240, 320
    y, x = np.mgrid[:height, :width]
    radius = diameter * height / 2
    down, across = (y - height / 2) / radius, (x - width / 2) / radius
    rows = np.clip((down * 0.45 + 0.5) * photo.shape[0], 0, photo.shape[0] - 1).astype(int)
    columns = np.clip((across * 0.45 + 0.5) * photo.shape[1], 0, photo.shape[1] - 1).astype(int)
    shown = photo[rows, columns].astype(int)
    shown[np.hypot(down, across) > 1] = 4
    noise = np.random.default_rng(seed).integers(-3, 4, shown.shape)
    return np.clip(shown + noise, 0, 255).astype(np.uint8)


def museum(number: int) -> NDArray[np.uint8]:
    with Image.open(MUSEUM / f"view_{number:02d}.jpg") as photo:
        return np.asarray(photo.convert("RGB").resize((400, 300)))


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "webp", "heic"])
@pytest.mark.parametrize(
    "statement",
    [
        'GPano:ProjectionType="equirectangular"/>',
        "><GPano:ProjectionType>cylindrical</GPano:ProjectionType></rdf:Description>",
    ],
)
def test_picture_whose_file_says_panorama_is_refused(tmp_path: Path, suffix: str, statement: str) -> None:
    xmp = _XMP.format(statement)
    options: dict[str, object] = {"xmp": xmp.encode()}
    if suffix == "png":
        info = PngInfo()
        info.add_itxt("XML:com.adobe.xmp", xmp)
        options = {"pnginfo": info}
    if suffix == "tif":
        options = {"tiffinfo": {700: xmp.encode()}}
    Image.fromarray(textured(0)).save(tmp_path / f"a.{suffix}", format="HEIF" if suffix == "heic" else None, **options)
    save(tmp_path / "good.png", textured(1))
    used, rejected = names(tmp_path)
    assert used == ["good.png"] and list(rejected.values()) == [PANORAMA]


@pytest.mark.parametrize("height", [128, 400, 900])
def test_panorama_without_any_statement_is_known_by_its_edges(tmp_path: Path, height: int) -> None:
    for seed in range(3):
        save(tmp_path / f"{seed}.jpg", panorama(seed, height=height), quality=92)
    with pytest.raises(PhotoError, match="0.jpg: It is a 360 degree panorama"):
        read_photos(tmp_path, SMALL)


def test_ordinary_photos_of_two_to_one_are_used(tmp_path: Path) -> None:
    for number in range(4):
        save(tmp_path / f"{number}.jpg", museum(number)[50:250], quality=92)
    # A plain backdrop joins at its sides as well as a panorama does.
    studio = np.full((200, 400, 3), 230, np.uint8)
    studio[60:180, 120:280] = museum(5)[60:180, 120:280]
    studio = (studio * np.linspace(0.8, 1.0, 200)[:, None, None]).astype(np.uint8)
    save(tmp_path / "studio.jpg", studio, quality=92)
    assert names(tmp_path) == (["0.jpg", "1.jpg", "2.jpg", "3.jpg", "studio.jpg"], {})


def test_panorama_that_a_phone_put_together_is_refused(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x010F] = "Apple"
    exif.get_ifd(0x8769)[0xA401] = 6
    save(tmp_path / "a.jpg", textured(0, width=200), exif=exif.tobytes())
    save(tmp_path / "good.png", textured(1))
    used, rejected = names(tmp_path)
    assert used == ["good.png"] and rejected["a.jpg"].startswith("It is a panorama that was put together")


@pytest.mark.parametrize("diameter", [0.9, 0.99, 1.15])
def test_fisheye_pictures_are_refused_unless_their_lens_is_given(tmp_path: Path, diameter: float) -> None:
    for number in range(3):
        save(tmp_path / f"{number}.jpg", fisheye(museum(number), number, diameter=diameter), quality=92)
    save(tmp_path / "ordinary.jpg", museum(9), quality=92)
    used, rejected = names(tmp_path)
    assert used == ["ordinary.jpg"]
    assert all(reason.startswith("It is a fisheye picture, round with black corners") for reason in rejected.values())
    assert len(read_photos(tmp_path, PhotoSettings(min_side=32, keep_fisheye=True)).photos) == 4


@pytest.mark.parametrize(
    ("model", "is_given", "kept"),
    [("SIMPLE_RADIAL", False, False), ("OPENCV_FISHEYE", False, True), ("OPENCV", True, True)],
)
def test_fisheye_pictures_are_kept_for_a_lens_that_describes_them(model: str, is_given: bool, kept: bool) -> None:
    assert PhotoSettings().for_lens(model, is_given=is_given).keep_fisheye is kept


def test_round_objects_on_black_are_ordinary_photos(tmp_path: Path) -> None:
    y, x = np.mgrid[:240, :320]
    for number, (radius, flat) in enumerate(((100, 1.0), (112, 0.8), (108, 0.9), (60, 1.0))):
        photo = museum(number)[:240, :320].copy()
        photo[np.hypot((x - 160) / radius, (y - 120) / (flat * radius)) > 1] = 2
        save(tmp_path / f"{number}.jpg", photo, quality=92)
    assert len(names(tmp_path)[0]) == 4


def test_unfinished_picture_of_a_panorama_camera_is_refused(tmp_path: Path) -> None:
    halves = [fisheye(museum(number), number)[:, 40:280] for number in range(2)]
    save(tmp_path / "a.jpg", np.hstack(halves), quality=92)
    save(tmp_path / "good.png", textured(1))
    assert names(tmp_path)[1]["a.jpg"].startswith("It is the unfinished picture of a 360 degree camera")


def test_screenshots_are_refused(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x9286] = b"ASCII\0\0\0Screenshot"
    save(tmp_path / "IMG_1.PNG", textured(0), exif=exif.tobytes())
    save(tmp_path / "Screenshot_2026-05-01.png", textured(1))
    save(tmp_path / "Bildschirmfoto 2026.png", textured(2))
    camera = Image.Exif()
    camera[0x010F], camera[0x0110] = "Canon", "EOS"
    save(tmp_path / "screenshot of the vase.jpg", textured(3), exif=camera.tobytes())
    used, rejected = names(tmp_path)
    assert used == ["screenshot of the vase.jpg"]
    assert set(rejected.values()) == {"It is a screenshot. Use the photo that it shows instead."}
    assert len(rejected) == 3


@pytest.mark.data
@pytest.mark.parametrize("scene", ["sakharov_statue32", "banana16", "skull66", "herz_jesus25", "meeting_place9"])
def test_no_photo_of_a_real_set_is_taken_for_a_panorama_or_fisheye(data_folder: Path, scene: str) -> None:
    rejected = read_photos(data_folder / scene / "photos").rejected
    assert [photo for photo in rejected if "panorama" in photo.reason or "fisheye" in photo.reason] == []
