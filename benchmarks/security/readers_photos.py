"""Readers of pictures: photos with EXIF, masks, prompts, true masks."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .reader import Reader, addon

_SIDE = 32
_EXIF = {0x829A: (1, 100), 0x829D: (28, 10), 0x8827: 100, 0x920A: (50, 1), 0xA405: 50, 0xA002: _SIDE, 0xA003: _SIDE}


def _picture(mode: str = "RGB") -> Any:
    from PIL import Image

    pixels = np.random.default_rng(0).integers(0, 256, (_SIDE, _SIDE, 4), np.uint8)
    # Smooth, so that the file is small.
    pixels[8:] = 128
    if mode == "I;16":
        return Image.fromarray(pixels[..., 0].astype(np.uint16) * 257)
    return Image.fromarray(pixels).convert(mode)


def _write_photo(folder: Path, name: str, mode: str = "RGB", **options: Any) -> None:
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112] = 6
    exif.get_ifd(0x8769).update(_EXIF)
    (folder / "photos").mkdir()
    picture = _picture(mode)
    if name.endswith(".heic"):
        # Smaller ones than the smallest block of the encoder are cropped, which is left to libheif.
        picture = picture.resize((64, 64))
    # pillow-heif reads the rotation from bytes only; Pillow writes TIFF tags from the object only.
    picture.save(folder / "photos" / name, exif=exif.tobytes() if name.endswith(".heic") else exif, **options)


def _write_heic(folder: Path, **options: Any) -> None:
    from engine.photos.heic import can_read_heic

    if not can_read_heic():
        raise RuntimeError("pillow-heif is not installed; run `make setup`.")
    _write_photo(folder, "a.heic", quality=40, **options)


def _read_photos(folder: Path) -> object:
    """Read the photo as `reconstruct` does: header, EXIF, statistics, and pixels at two sizes."""
    from engine.photos import inspect_photos, load_pixels, read_photos
    from engine.photos.settings import PhotoSettings

    masks = folder / "masks"
    photo_set = read_photos(folder / "photos", PhotoSettings(min_side=1), masks=masks if masks.is_dir() else None)
    inspect_photos(photo_set)
    photo = photo_set.photos[0]
    return photo, load_pixels(folder / "photos" / photo.name, max_side=8)


def _show_photo(folder: Path) -> object:
    frame = addon("project.photo_frame")
    file = folder / "photos" / "a.jpg"
    frame.require_small(file, 1_000_000)
    return frame.exif_orientation(file)


def _prepare(folder: Path) -> Any:
    """Continue in the work folder of the cameras: its key, COLMAP's database, a share of its pairs, copies, masks."""
    from engine.cameras.features import SfmWorkspace
    from engine.cameras.matching import match_pairs
    from engine.cameras.settings import CameraSettings
    from engine.cameras.working_copies import write_copies
    from engine.scene import Photo, PhotoSet

    mask = folder / "masks" / "a.jpg.png"
    photos = PhotoSet(folder / "photos", (Photo("a.jpg", _SIDE, _SIDE, None, "0" * 64, str(mask), "1" * 64),), ())
    work = SfmWorkspace(folder / "work", photos, CameraSettings())
    had_all = work.database.is_file()
    write_copies(work.copies, photos.folder, work.images, work.masks, report=lambda _: None, should_stop=lambda: False)
    if had_all:
        match_pairs(work.database, [], CameraSettings(), report=lambda _: None, should_stop=lambda: False)
    return work if had_all else None


def _write_work_folder(folder: Path) -> None:
    from engine.cameras.colmap import pycolmap

    _write_masked_photo(folder)
    _prepare(folder)
    share = folder / "work" / "shares" / "000"
    share.mkdir(parents=True)
    for database in (folder / "work", share):
        pycolmap.Database.open(database / "database.db").close()


def _write_masked_photo(folder: Path) -> None:
    _write_photo(folder, "a.jpg", quality=40)
    (folder / "masks").mkdir()
    _picture("L").point(lambda value: 255 * (value > 127)).save(folder / "masks" / "a.jpg.png")


def _write_prompt(folder: Path, mode: str = "L") -> None:
    _picture(mode).save(folder / "mask.png")


def _read_prompt(folder: Path) -> object:
    from engine.objects.prompts import load_mask
    from engine.scene import Camera

    camera = Camera("a.jpg", _SIDE, _SIDE, "PINHOLE", (30.0, 30.0, 16.0, 16.0), np.eye(4))
    return load_mask(folder / "mask.png", camera)


def _write_museum(folder: Path) -> None:
    (folder / "masks").mkdir()
    _picture("L").point(lambda value: value // 128).save(folder / "masks" / "a.png")
    names = {"1": {"prompt": "vase"}, "2": {"prompt": "cup", "name": "cup 2"}, "3": {"prompt": "shelf", "ignore": True}}
    (folder / "names.json").write_text(json.dumps(names))
    (folder / "absent.json").write_text(json.dumps(["dog"]))


def _write_lerf_mask(folder: Path) -> None:
    (folder / "test_mask" / "a").mkdir(parents=True)
    _picture("L").save(folder / "test_mask" / "a" / "vase.png")


def _write_three_d_ovs(folder: Path) -> None:
    (folder / "segmentations" / "a").mkdir(parents=True)
    _picture("L").save(folder / "segmentations" / "a" / "vase.png")
    (folder / "segmentations" / "classes.txt").write_text("vase\n")


def _write_lerf_ovs(folder: Path) -> None:
    things = [{"category": "vase", "segmentation": [[1, 1], [9, 1], [9, 9.5]]}]
    (folder / "a.json").write_text(
        json.dumps({"info": {"name": "a.jpg", "width": 20, "height": 15}, "objects": things})
    )


def _read_truth(folder: Path) -> object:
    from engine.quality.evaluation import read_ground_truth

    truth = read_ground_truth(folder, ["a.jpg"], ["b.jpg"])
    return [truth.masks(photo) for photo in truth.photos]


def _photo_reader(name: str, file: str, write: Callable[[Path], None], share: float = 1.0) -> Reader:
    return Reader(name, write, _read_photos, (f"photos/{file}",), share)


def _write_video(folder: Path) -> None:
    """Write a short video of a moving camera, and the record of an earlier call."""
    import cv2

    texture = np.random.default_rng(0).integers(0, 255, (64, 256, 3), np.uint8)
    writer = cv2.VideoWriter(str(folder / "a.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, (64, 64))
    for step in range(20):
        writer.write(texture[:, 8 * step : 8 * step + 64])
    writer.release()
    record = {"made_from": "00", "settings": {}, "files": ["frame_000001.jpg"], "complete": True}
    (folder / "frame.frames.json").write_text(json.dumps(record))


def _frames_of_video(folder: Path) -> object:
    from engine.core.events import ignore_events, never_stop
    from engine.photos import extract_frames
    from engine.photos.settings import VideoSettings

    return extract_frames(
        folder / "a.mp4", folder, VideoSettings(min_frames=3), emit=ignore_events, should_stop=never_stop
    )


PHOTOS: tuple[Reader, ...] = (
    _photo_reader("photo-jpeg", "a.jpg", partial(_write_photo, name="a.jpg", quality=40), share=3.0),
    _photo_reader("photo-progressive", "a.jpg", partial(_write_photo, name="a.jpg", quality=40, progressive=True)),
    _photo_reader("photo-cmyk", "a.jpg", partial(_write_photo, name="a.jpg", mode="CMYK", quality=40)),
    _photo_reader("photo-png", "a.png", partial(_write_photo, name="a.png", mode="RGBA"), share=2.0),
    _photo_reader("photo-png-16", "a.png", partial(_write_photo, name="a.png", mode="I;16")),
    _photo_reader("photo-tiff", "a.tif", partial(_write_photo, name="a.tif"), share=2.0),
    _photo_reader("photo-tiff-lzw", "a.tif", partial(_write_photo, name="a.tif", compression="tiff_lzw")),
    _photo_reader("photo-heic", "a.heic", _write_heic, share=3.0),
    _photo_reader("photo-heic-tiles", "a.heic", partial(_write_heic, tile_size=16), share=2.0),
    _photo_reader("photo-webp", "a.webp", partial(_write_photo, name="a.webp", quality=40)),
    Reader("photo-mask", _write_masked_photo, _read_photos, ("masks/a.jpg.png",)),
    Reader(
        "camera-work",
        _write_work_folder,
        _prepare,
        (
            "work/made_from.json",
            "work/database.db",
            "work/shares/000/database.db",
            "work/images/00000/000000.jpg",
            "work/masks/00000/000000.jpg.png",
        ),
    ),
    Reader("photo-in-blender", partial(_write_photo, name="a.jpg", quality=40), _show_photo, ("photos/a.jpg",)),
    Reader("mask-prompt", _write_prompt, _read_prompt, ("mask.png",)),
    Reader("truth-museum", _write_museum, _read_truth, ("names.json", "absent.json", "masks/a.png")),
    Reader("truth-lerf-mask", _write_lerf_mask, _read_truth, ("test_mask/a/vase.png",)),
    Reader("truth-3d-ovs", _write_three_d_ovs, _read_truth, ("segmentations/classes.txt", "segmentations/a/vase.png")),
    Reader("truth-lerf-ovs", _write_lerf_ovs, _read_truth, ("a.json",)),
    Reader("video", _write_video, _frames_of_video, ("a.mp4", "frame.frames.json"), share=2.0),
)
