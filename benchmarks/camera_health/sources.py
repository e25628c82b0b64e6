"""Pictures and given cameras of the photo sets: sources, changes of pictures, and the writers of folders."""

from __future__ import annotations

import functools
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from benchmarks.training.photo_sets import photo_set
from engine.cameras import estimate_cameras
from engine.cameras.settings import CameraSettings
from engine.core.arrays import Float64
from engine.photos import read_photos

from .box_room import BoxRoom, Projection, looking_along, rays

Pictures = Sequence[tuple[str, Image.Image]]

QUICK = CameraSettings(max_side=800, max_features=800, first_octave=0)
"""Settings of sets whose cameras are estimated quickly."""
_SIDE = 800
_COUNT = 16
_BOX_COUNT = 12
_BOX_RADIUS = 1.8


# ---- pictures


def _reduced(picture: Image.Image) -> Image.Image:
    picture = ImageOps.exif_transpose(picture).convert("RGB")
    picture.thumbnail((_SIDE, _SIDE), Image.Resampling.LANCZOS)
    return picture


def _chosen(name: str, available: int, count: int) -> list[int]:
    """Return the photos to take: evenly spaced ones, but the first of ``skull66``, and all of the sparse ``room_7``."""
    if name == "room_7" or count >= available:
        return list(range(available))
    last = count - 1 if name == "skull66" else available - 1
    return sorted({round(i) for i in np.linspace(0, last, count)})


@functools.lru_cache(maxsize=3)
def _pictures(name: str, count: int = _COUNT) -> tuple[tuple[str, Image.Image], ...]:
    """Return photos of a set in the order of their names, those of `_chosen`."""
    files = sorted(photo_set(name).photos.glob("*.[jJ]*"))
    chosen = _chosen(name, len(files), count)
    return tuple((f"{name}_{index:02d}.jpg", _reduced(Image.open(files[index]))) for index in chosen)


def _true_viewmats(name: str) -> dict[str, tuple[Float64, dict[str, float]]]:
    """Return the true pose and lens of each picture of `_pictures`; empty for real sets."""
    file = photo_set(name).photos.with_name("truth") / "cameras.json"
    if not file.is_file():
        return {}
    photos = {photo["file"]: photo for photo in json.loads(file.read_text())["photos"]}
    names = sorted(photos)
    result = {}
    for index in _chosen(name, len(names), _COUNT):
        photo = photos[names[index]]
        scale = min(1.0, _SIDE / max(photo["width"], photo["height"]))
        lens = {key: value * (1.0 if key == "k1" else scale) for key, value in photo["params"].items()}
        result[f"{name}_{index:02d}.jpg"] = (np.array(photo["world_to_camera"]), lens)
    return result


def positions(name: str) -> dict[str, Float64]:
    return {photo: -m[:3, :3].T @ m[:3, 3] for photo, (m, _) in _true_viewmats(name).items()}


def _save(folder: Path, pictures: Pictures) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures:
        picture.save(folder / name, quality=95)


Change = Callable[[int, Image.Image], Image.Image]


def changed(name: str, change: Change) -> Callable[[Path], None]:
    """Return a writer of the set `name` with `change` applied to the picture of each index."""

    def write(folder: Path) -> None:
        _save(folder, [(file, change(index, one)) for index, (file, one) in enumerate(_pictures(name))])

    return write


def original_files(name: str) -> Callable[[Path], None]:
    """Return a writer of all photos of a set as they are."""

    def write(folder: Path) -> None:
        shutil.copytree(photo_set(name).photos, folder)

    return write


# ---- changes of pictures


def as_it_is(index: int, picture: Image.Image) -> Image.Image:
    return picture


def zoomed(*zooms: float) -> Change:
    def change(index: int, picture: Image.Image) -> Image.Image:
        zoom = zooms[index % len(zooms)]
        w, h = picture.size
        box = (w / 2 - w / 2 / zoom, h / 2 - h / 2 / zoom, w / 2 + w / 2 / zoom, h / 2 + h / 2 / zoom)
        return picture.resize((w, h), Image.Resampling.LANCZOS, box=box)

    return change


def mirrored(which: Callable[[int], bool]) -> Change:
    return lambda index, picture: ImageOps.mirror(picture) if which(index) else picture


def stretched(factor: float, which: Callable[[int], bool]) -> Change:
    """Return a change to a picture that is wider by `factor`, in the size that all others have."""

    def change(index: int, picture: Image.Image) -> Image.Image:
        w, h = picture.size
        if not which(index):
            return picture
        box = (w / 2 - w / 2 / factor, 0, w / 2 + w / 2 / factor, h)
        return picture.resize((w, h), Image.Resampling.LANCZOS, box=box)

    return change


def doubled(index: int, picture: Image.Image) -> Image.Image:
    """Return what a decoder makes of 16-bit planes that it reads as 8 bits: every row is half a row of the photo."""
    pixels = np.asarray(picture)
    height, width, _ = pixels.shape
    width -= width % 2
    y, x = np.mgrid[0:height, 0:width]
    return Image.fromarray(pixels[y // 2, (y % 2) * (width // 2) + x // 2])


def cropped(share: float, corner: Callable[[int, np.random.Generator], tuple[float, float]]) -> Change:
    """Return a change that keeps `share` of each side, at a place that `corner` returns, 0 to 1."""

    def change(index: int, picture: Image.Image) -> Image.Image:
        w, h = picture.size
        x, y = corner(index, np.random.default_rng(index))
        left, top = x * (1 - share) * w, y * (1 - share) * h
        return picture.crop((round(left), round(top), round(left) + round(share * w), round(top) + round(share * h)))

    return change


# ---- rendered boxes


def _walk(count: int, turn: float, radius: float) -> Iterator[Float64]:
    """Yield poses on a ring inside of the room; `turn` radians is the angle between where they look and outwards."""
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False):
        center = np.array(
            [1.6 * radius * np.cos(angle), radius * np.sin(angle), 1.4 + 0.15 * radius * np.sin(3 * angle)]
        )
        look = angle + turn
        yield looking_along(center, np.array([np.cos(look), np.sin(look), -0.1]))


def boxes(
    seed: int,
    projection: Projection = "pinhole",
    *,
    size: tuple[int, int] = (640, 480),
    focal: float = 420.0,
    count: int = _BOX_COUNT,
    radius: float = _BOX_RADIUS,
    turn: float = np.pi,
    same_walls: bool = False,
    cut: float = 0.0,
    change: Change | None = None,
) -> Callable[[Path], None]:
    """Return a writer of photos from a ring inside of a `BoxRoom`."""

    def write(folder: Path) -> None:
        room = BoxRoom(seed, same_walls)
        pictures = []
        for index, viewmat in enumerate(_walk(count, turn, radius)):
            directions = rays(*size, projection, focal) @ viewmat[:3, :3]
            picture = room.picture(-viewmat[:3, :3].T @ viewmat[:3, 3], directions)
            margin = round(cut * size[1])
            picture = picture.crop((0, margin, size[0], size[1] - margin))
            pictures.append((f"box_{index:02d}.jpg", change(index, picture) if change else picture))
        _save(folder, pictures)

    return write


def box_positions() -> dict[str, Float64]:
    """Return the positions of the photos of `boxes` with its default ring."""
    poses = _walk(_BOX_COUNT, np.pi, _BOX_RADIUS)
    return {f"box_{index:02d}.jpg": -m[:3, :3].T @ m[:3, 3] for index, m in enumerate(poses)}


# ---- given cameras


Order = Callable[[list[str]], list[str]]


def given(name: str, order: Order, *, focal: float = 1.0) -> Callable[[Path], Path]:
    """Return a writer of a set with its true cameras whose names are in another `order`.

    `focal` is a factor of the focal lengths.
    """

    def write(folder: Path) -> Path:
        _save(folder, _pictures(name))
        cameras = _true_viewmats(name)
        return _transforms(
            folder,
            [
                (photo, viewmat, {**lens, "f": lens["f"] * focal})
                for photo, (viewmat, lens) in zip(order(list(cameras)), cameras.values(), strict=True)
            ],
        )

    return write


def _transforms(folder: Path, cameras: Sequence[tuple[str, Float64, dict[str, float]]]) -> Path:
    """Write cameras (photo, world to camera, lens) as ``transforms.json`` beside the photos, and return its path."""
    frames = []
    for photo, viewmat, lens in cameras:
        width, height = Image.open(folder / photo).size
        frames.append(
            {
                "file_path": photo, "w": width, "h": height, "cx": lens["cx"], "cy": lens["cy"],
                "fl_x": lens["f"], "fl_y": lens["f"], "k1": lens["k1"], "k2": 0.0, "p1": 0.0, "p2": 0.0,
                "transform_matrix": (np.linalg.inv(viewmat) @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist(),
            }
        )  # fmt: skip
    model = folder.parent / "transforms.json"
    model.write_text(json.dumps({"camera_model": "OPENCV", "frames": frames}))
    return model


def given_by_estimate(name: str, order: Order) -> Callable[[Path], Path]:
    """Return a writer of a real set with cameras that were estimated from it, whose names are in another `order`."""

    def write(folder: Path) -> Path:
        _save(folder, _pictures(name))
        cameras = estimate_cameras(read_photos(folder), folder.parent / "given", QUICK).cameras
        renamed = order([camera.photo for camera in cameras])
        return _transforms(
            folder,
            [
                (photo, camera.viewmat, {"f": camera.params[0], "cx": camera.params[1], "cy": camera.params[2],
                                         "k1": camera.params[3]})
                for photo, camera in zip(renamed, cameras, strict=True)
            ],
        )  # fmt: skip

    return write


def swapped(*pairs: tuple[int, int]) -> Order:
    def order(names: list[str]) -> list[str]:
        names = list(names)
        for a, b in pairs:
            names[a], names[b] = names[b], names[a]
        return names

    return order


def together(first: str, second: str, counts: tuple[int, int]) -> Callable[[Path], None]:
    return lambda folder: _save(folder, _pictures(first, counts[0]) + _pictures(second, counts[1]))
