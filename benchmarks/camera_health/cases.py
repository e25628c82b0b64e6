"""The photo sets of the benchmark: sound ones, and spoilt ones with the causes that the health check may name."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from benchmarks.rooms.draws import KEPT_ROOMS
from benchmarks.rooms.keeping import unpack_room

from .box_room import BoxRoom, Projection, looking_along, rays

__all__ = ["PhotoCase", "photo_cases"]

Float64 = NDArray[np.float64]
Pictures = Sequence[tuple[str, Image.Image]]

_ROOT = Path(__file__).parents[2]
_SIDE = 800
_COUNT = 16
_BOX_COUNT = 12
_BOX_RADIUS = 1.8
_REAL = ("banana16", "herz_jesus25", "meeting_place9", "sakharov_statue32", "skull66")


@dataclass(frozen=True)
class PhotoCase:
    """One photo set.

    Attributes
    ----------
    name : str
        Kind and source.
    causes : tuple of str
        Causes of `engine.scene.CameraHealth` that name the fault; empty for a sound set.
    choosing : bool
        Whether thresholds may be chosen on it.
    write : callable
        Writes the photos to a folder and returns a camera model, or None where cameras are estimated.
    positions : dict of str to array of shape [3]
        True positions by photo, where known.
    """

    name: str
    causes: tuple[str, ...]
    choosing: bool
    write: Callable[[Path], Path | None]
    positions: dict[str, Float64] = field(default_factory=dict)


# ---- pictures


def _reduced(picture: Image.Image) -> Image.Image:
    picture = ImageOps.exif_transpose(picture).convert("RGB")
    picture.thumbnail((_SIDE, _SIDE), Image.Resampling.LANCZOS)
    return picture


def _folder_of(name: str, kept: Path) -> Path:
    if name in _REAL:
        return Path(os.environ["GAUSSIAN_HERITAGE_DATA"]) / name
    if name == "museum_room":
        return _ROOT / "demo" / name
    folder = kept / name
    if not (folder / "photos").is_dir():
        unpack_room(_ROOT / KEPT_ROOMS / f"{name}.tar.xz", folder)
    return folder


def _chosen(name: str, available: int, count: int) -> list[int]:
    """Return the photos to take: evenly spaced ones, but the first of ``skull66``, and all of the sparse ``room_7``."""
    if name == "room_7" or count >= available:
        return list(range(available))
    last = count - 1 if name == "skull66" else available - 1
    return sorted({round(i) for i in np.linspace(0, last, count)})


@functools.lru_cache(maxsize=3)
def _pictures(name: str, kept: Path, count: int = _COUNT) -> tuple[tuple[str, Image.Image], ...]:
    """Return photos of a set in the order of their names, those of `_chosen`."""
    files = sorted((_folder_of(name, kept) / "photos").glob("*.[jJ]*"))
    chosen = _chosen(name, len(files), count)
    return tuple((f"{name}_{index:02d}.jpg", _reduced(Image.open(files[index]))) for index in chosen)


def _true_viewmats(name: str, kept: Path, count: int = _COUNT) -> dict[str, tuple[Float64, dict[str, float]]]:
    """Return the true pose and lens of each picture of `_pictures`; empty for real sets."""
    file = _folder_of(name, kept) / "truth" / "cameras.json"
    if not file.is_file():
        return {}
    photos = {photo["file"]: photo for photo in json.loads(file.read_text())["photos"]}
    names = sorted(photos)
    result = {}
    for index in _chosen(name, len(names), count):
        photo = photos[names[index]]
        scale = min(1.0, _SIDE / max(photo["width"], photo["height"]))
        lens = {key: value * (1.0 if key == "k1" else scale) for key, value in photo["params"].items()}
        result[f"{name}_{index:02d}.jpg"] = (np.array(photo["world_to_camera"]), lens)
    return result


def _positions(name: str, kept: Path) -> dict[str, Float64]:
    return {photo: -m[:3, :3].T @ m[:3, 3] for photo, (m, _) in _true_viewmats(name, kept).items()}


def _save(folder: Path, pictures: Pictures) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures:
        picture.save(folder / name, quality=95)


Change = Callable[[int, Image.Image], Image.Image]


def _changed(name: str, kept: Path, change: Change) -> Callable[[Path], None]:
    """Return a writer of the set `name` with `change` applied to the picture of each index."""

    def write(folder: Path) -> None:
        _save(folder, [(file, change(index, one)) for index, (file, one) in enumerate(_pictures(name, kept))])

    return write


# ---- changes of pictures


def _as_it_is(index: int, picture: Image.Image) -> Image.Image:
    return picture


def _zoomed(*zooms: float) -> Change:
    def change(index: int, picture: Image.Image) -> Image.Image:
        zoom = zooms[index % len(zooms)]
        w, h = picture.size
        box = (w / 2 - w / 2 / zoom, h / 2 - h / 2 / zoom, w / 2 + w / 2 / zoom, h / 2 + h / 2 / zoom)
        return picture.resize((w, h), Image.Resampling.LANCZOS, box=box)

    return change


def _mirrored(which: Callable[[int], bool]) -> Change:
    return lambda index, picture: ImageOps.mirror(picture) if which(index) else picture


def _stretched(factor: float, which: Callable[[int], bool]) -> Change:
    """Return a change to a picture that is wider by `factor`, in the size that all others have."""

    def change(index: int, picture: Image.Image) -> Image.Image:
        w, h = picture.size
        if not which(index):
            return picture
        box = (w / 2 - w / 2 / factor, 0, w / 2 + w / 2 / factor, h)
        return picture.resize((w, h), Image.Resampling.LANCZOS, box=box)

    return change


def _doubled(index: int, picture: Image.Image) -> Image.Image:
    """Return what a decoder makes of 16-bit planes that it reads as 8 bits: every row is half a row of the photo."""
    pixels = np.asarray(picture)
    height, width, _ = pixels.shape
    width -= width % 2
    y, x = np.mgrid[0:height, 0:width]
    return Image.fromarray(pixels[y // 2, (y % 2) * (width // 2) + x // 2])


def _cropped(share: float, corner: Callable[[int, np.random.Generator], tuple[float, float]]) -> Change:
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


def _boxes(
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
) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        room = BoxRoom(seed, same_walls)
        pictures = []
        for index, viewmat in enumerate(_walk(count, turn, radius)):
            directions = rays(*size, projection, focal) @ viewmat[:3, :3]
            picture = room.picture(-viewmat[:3, :3].T @ viewmat[:3, 3], directions)
            margin = round(cut * size[1])
            pictures.append((f"box_{index:02d}.jpg", picture.crop((0, margin, size[0], size[1] - margin))))
        _save(folder, pictures)

    return write


def _box_positions() -> dict[str, Float64]:
    """Return the positions of the photos of `_boxes` with its default ring."""
    poses = _walk(_BOX_COUNT, np.pi, _BOX_RADIUS)
    return {f"box_{index:02d}.jpg": -m[:3, :3].T @ m[:3, 3] for index, m in enumerate(poses)}


# ---- given cameras


def _given(
    name: str, kept: Path, order: Callable[[list[str]], list[str]], *, focal: float = 1.0
) -> Callable[[Path], Path]:
    """Return a writer of a set with its true cameras as a COLMAP model whose names are in another `order`."""

    def write(folder: Path) -> Path:
        _save(folder, _pictures(name, kept))
        cameras = _true_viewmats(name, kept)
        renamed = dict(zip(cameras, order(list(cameras)), strict=True))
        frames = []
        for photo, (viewmat, lens) in cameras.items():
            width, height = Image.open(folder / renamed[photo]).size
            pose = np.linalg.inv(viewmat) @ np.diag([1.0, -1.0, -1.0, 1.0])
            frames.append(
                {
                    "file_path": renamed[photo], "w": width, "h": height, "cx": lens["cx"], "cy": lens["cy"],
                    "fl_x": lens["f"] * focal, "fl_y": lens["f"] * focal,
                    "k1": lens["k1"], "k2": 0.0, "p1": 0.0, "p2": 0.0,
                    "transform_matrix": pose.tolist(),
                }
            )  # fmt: skip
        model = folder.parent / "transforms.json"
        model.write_text(json.dumps({"camera_model": "OPENCV", "frames": frames}))
        return model

    return write


def _swapped(*pairs: tuple[int, int]) -> Callable[[list[str]], list[str]]:
    def order(names: list[str]) -> list[str]:
        names = list(names)
        for a, b in pairs:
            names[a], names[b] = names[b], names[a]
        return names

    return order


def _together(first: str, second: str, kept: Path, counts: tuple[int, int]) -> Callable[[Path], None]:
    return lambda folder: _save(folder, _pictures(first, kept, counts[0]) + _pictures(second, kept, counts[1]))


def photo_cases(kept: Path) -> list[PhotoCase]:
    """Return all photo sets; `kept` is the folder in which the kept rooms are unpacked."""
    cases: list[PhotoCase] = []

    def add(
        name: str, causes: str, choosing: bool, write: Callable[[Path], Path | None], of: str | None = None
    ) -> None:
        positions = {} if of is None or of in _REAL else _box_positions() if of == "box" else _positions(of, kept)
        cases.append(PhotoCase(name, tuple(causes.split()), choosing, write, positions))

    def odd(index: int) -> bool:
        return index % 2 == 1

    # Sound sets. Odd rooms choose, even ones tell.
    generated = ["museum_room", *(f"room_{seed}" for seed in range(1, 9))]
    for name in (*generated, *_REAL):
        choosing = name in ("museum_room", "room_1", "room_3", "room_5", "room_7", "banana16", "sakharov_statue32")
        add(f"sound: {name}", "", choosing, _changed(name, kept, _as_it_is), name)
    add("sound: given cameras of room_1", "", True, _given("room_1", kept, list), "room_1")
    add("sound: given cameras of museum_room", "", False, _given("museum_room", kept, list), "museum_room")
    for seed in (1, 2):
        add(f"sound: box {seed}", "", seed == 1, _boxes(seed), "box")

    lenses, swapped = "several_lenses", "given_cameras"
    add(
        "zoom of every second photo: museum_room",
        lenses,
        True,
        _changed("museum_room", kept, _zoomed(1.0, 1.9)),
        "museum_room",
    )
    add("zoom of every second photo: room_2", lenses, False, _changed("room_2", kept, _zoomed(1.0, 1.6)), "room_2")
    add("three zooms: room_1", lenses, True, _changed("room_1", kept, _zoomed(1.0, 1.4, 2.2)), "room_1")
    add("zoom of every third photo: room_4", lenses, False, _changed("room_4", kept, _zoomed(1.0, 1.0, 2.0)), "room_4")
    add(
        "zoom of every second photo: sakharov_statue32",
        lenses,
        False,
        _changed("sakharov_statue32", kept, _zoomed(1.0, 1.5)),
    )

    add("two files swapped: room_3", swapped, True, _given("room_3", kept, _swapped((2, 9))), "room_3")
    add("two files swapped: room_2", swapped, False, _given("room_2", kept, _swapped((4, 5))), "room_2")
    add("order reversed: museum_room", swapped, True, _given("museum_room", kept, lambda n: n[::-1]), "museum_room")
    add("order shifted by one: room_6", swapped, False, _given("room_6", kept, lambda n: n[1:] + n[:1]), "room_6")
    add("wrong focal length given: room_4", swapped, False, _given("room_4", kept, list, focal=1.5), "room_4")

    add("mirrored half: museum_room", "mirrored", True, _changed("museum_room", kept, _mirrored(lambda i: i >= 8)))
    add("mirrored, every second photo: room_2", "mirrored", False, _changed("room_2", kept, _mirrored(odd)))
    add(
        "mirrored, three photos: room_5",
        "mirrored",
        True,
        _changed("room_5", kept, _mirrored(lambda i: i in (3, 7, 8))),
    )
    add(
        "mirrored half: sakharov_statue32",
        "mirrored",
        False,
        _changed("sakharov_statue32", kept, _mirrored(lambda i: i < 8)),
    )

    for seed in (3, 4, 5):
        add(f"duplicated wall: box {seed}", "repeated several_scenes", True, _boxes(seed, same_walls=True), "box")

    add("read as 8 bits, doubled: museum_room", "stretched unclear", True, _changed("museum_room", kept, _doubled))
    add("read as 8 bits, doubled: room_4", "stretched unclear", False, _changed("room_4", kept, _doubled))
    add(
        "stretched 1.33 times, all: room_1",
        "stretched",
        True,
        _changed("room_1", kept, _stretched(1.33, lambda i: True)),
    )
    add(
        "stretched 1.33 times, half: room_6",
        "stretched several_lenses",
        False,
        _changed("room_6", kept, _stretched(1.33, odd)),
    )
    add(
        "stretched 1.2 times, all: sakharov_statue32",
        "stretched",
        False,
        _changed("sakharov_statue32", kept, _stretched(1.2, lambda i: True)),
    )

    panorama = {"size": (800, 400), "radius": 1.0}
    add("panoramas: box 6", "panorama", True, _boxes(6, "panorama", **panorama))
    add("panoramas: box 7", "panorama", False, _boxes(7, "panorama", **panorama))
    add("panoramas without their poles: box 8", "panorama", False, _boxes(8, "panorama", **panorama, cut=0.2))
    add("fisheye: box 9", "fisheye", True, _boxes(9, "fisheye", focal=230.0))
    add("fisheye: box 10", "fisheye", False, _boxes(10, "fisheye", focal=260.0, size=(600, 600)))

    add(
        "two scenes: museum_room and sakharov_statue32",
        "several_scenes",
        True,
        _together("museum_room", "sakharov_statue32", kept, (8, 8)),
    )
    add("two scenes: room_2 and room_8", "several_scenes", True, _together("room_2", "room_8", kept, (8, 8)))
    add("two scenes: room_6 and banana16", "several_scenes", False, _together("room_6", "banana16", kept, (11, 5)))

    def any_corner(index: int, rng: np.random.Generator) -> tuple[float, float]:
        return float(rng.random()), float(rng.random())

    add(
        "cropped anywhere: museum_room",
        "cropped",
        True,
        _changed("museum_room", kept, _cropped(0.6, any_corner)),
        "museum_room",
    )
    add("cropped anywhere: room_8", "cropped", False, _changed("room_8", kept, _cropped(0.6, any_corner)), "room_8")
    add(
        "cropped to a side, half: room_3",
        "cropped",
        True,
        _changed("room_3", kept, _cropped(0.65, lambda i, _: (float(i % 2), 0.5))),
        "room_3",
    )
    add(
        "cropped to the left, all: room_2",
        "cropped",
        False,
        _changed("room_2", kept, _cropped(0.6, lambda i, _: (0.0, 0.0))),
        "room_2",
    )

    for seed in (11, 12):
        add(
            f"turned on one place: box {seed}", "one_place", seed == 11, _boxes(seed, radius=0.0, turn=0.0, focal=300.0)
        )
    return cases
