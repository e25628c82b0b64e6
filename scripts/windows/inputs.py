"""Photos, a video and cameras for the test on Windows, from the museum room of the repository."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from places import ROOT
from scipy.spatial.transform import Rotation

from .problem import Problem

ROOM = ROOT / "demo" / "museum_room"
ALL_PHOTOS = sorted((ROOM / "photos").glob("*.jpg"))
PHOTOS = ALL_PHOTOS[::4]
_EVERY_WITHOUT_EXIF = 4
_FRAMES_PER_PHOTO, _FRAMES_PER_SECOND = 4, 12.0
_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def write_photos(folder: Path) -> None:
    """Copy a quarter of the room's photos; every fourth is stored anew without EXIF, as messengers send photos."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, photo in enumerate(PHOTOS):
        target = folder / photo.name
        if target.exists():
            continue
        if number % _EVERY_WITHOUT_EXIF:
            shutil.copy(photo, target)
        else:
            _, content = cv2.imencode(".jpg", read_picture(photo), [cv2.IMWRITE_JPEG_QUALITY, 92])
            target.write_bytes(content.tobytes())


def read_picture(photo: Path) -> Any:
    """Return the pixels of a photo of the room."""
    picture = cv2.imread(str(photo))
    if picture is None:
        raise Problem(f"{photo} cannot be read.")
    return picture


def write_video(file: Path) -> None:
    """Write all views of the room as a video."""
    file.parent.mkdir(parents=True, exist_ok=True)
    pictures = [read_picture(photo) for photo in ALL_PHOTOS]
    height, width = pictures[0].shape[:2]
    plain = file.with_name("video.mp4")
    film = cv2.VideoWriter(str(plain), cv2.VideoWriter.fourcc(*"mp4v"), _FRAMES_PER_SECOND, (width, height))
    for picture in pictures:
        for _ in range(_FRAMES_PER_PHOTO):
            film.write(picture)
    film.release()
    plain.replace(file)


def write_transforms(file: Path) -> None:
    """Write the true cameras of `PHOTOS` as nerfstudio does."""
    frames = []
    for photo in _true_photos():
        lens = photo["params"]
        pose = np.linalg.inv(np.array(photo["world_to_camera"])) @ _OPENGL
        frames.append(
            {
                "file_path": photo["file"], "transform_matrix": pose.tolist(), "fl_x": lens["f"], "fl_y": lens["f"],
                "cx": lens["cx"], "cy": lens["cy"], "w": photo["width"], "h": photo["height"], "k1": lens["k1"],
            }
        )  # fmt: skip
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({"camera_model": "OPENCV", "frames": frames}), encoding="utf-8")


def write_colmap_model(folder: Path) -> None:
    """Write the true cameras of `PHOTOS` as a COLMAP model in text, without points."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras, images = [], []
    for number, photo in enumerate(_true_photos(), 1):
        lens, pose = photo["params"], np.array(photo["world_to_camera"])
        values = " ".join(str(lens[name]) for name in ("f", "cx", "cy", "k1"))
        cameras.append(f"{number} {photo['model']} {photo['width']} {photo['height']} {values}")
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
        moved = " ".join(str(value) for value in pose[:3, 3])
        images.append(f"{number} {w} {x} {y} {z} {moved} {number} {photo['file']}\n")
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n", encoding="utf-8")
    (folder / "images.txt").write_text("\n".join(images) + "\n", encoding="utf-8")
    (folder / "points3D.txt").write_text("", encoding="utf-8")


def _true_photos() -> list[dict[str, Any]]:
    truth = json.loads((ROOM / "truth" / "cameras.json").read_text(encoding="utf-8"))
    names = {photo.name for photo in PHOTOS}
    return [photo for photo in truth["photos"] if photo["file"] in names]
