"""Photo folders drawn from a seed: formats, rotations, copies, names and files that are no photos."""

from __future__ import annotations

import io
import json
import unicodedata
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pillow_heif
import tifffile
from numpy.typing import NDArray
from PIL import Image

from ..places import ROOT

_ROOM = ROOT / "demo" / "museum_room"
WIDTH, HEIGHT = 320, 240
_ORIENTATION = 0x0112
_SUFFIXES = {"JPEG": ".jpg", "PNG": ".png", "WebP": ".webp", "HEIC": ".heic", "TIFF": ".tif", "TIFF 16 bits": ".tif"}
_STORED = {
    1: None, 2: Image.Transpose.FLIP_LEFT_RIGHT, 3: Image.Transpose.ROTATE_180, 4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE, 6: Image.Transpose.ROTATE_90, 7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_270,
}  # fmt: skip
"""How the upright picture becomes the stored one, by EXIF orientation."""


@dataclass
class Shot:
    """A photo that must be used.

    Attributes
    ----------
    names : list of str
        The photo and its copies of equal size; one of them is used.
    pixels : array of shape [h, w, 3], uint8
        The upright picture.
    viewmat : array of shape [4, 4], float64
        World-to-camera of the upright picture.
    focal : float
        In its pixels.
    orientation : int
        EXIF orientation of the file.
    """

    names: list[str]
    pixels: NDArray[np.uint8]
    viewmat: NDArray[np.float64]
    focal: float
    orientation: int


@dataclass
class Mixture:
    """A folder with its truth: the shots, files with the reason that must be told, and the kinds that it mixes."""

    folder: Path
    shots: list[Shot]
    told: list[str] = field(default_factory=list)
    kinds: set[str] = field(default_factory=set)


def draw_folder(rng: np.random.Generator, folder: Path) -> Mixture:
    """Write a photo folder drawn from `rng`; return its truth."""
    folder.mkdir(parents=True)
    views = json.loads((_ROOM / "truth" / "cameras.json").read_text(encoding="utf-8"))["photos"]
    first = int(rng.integers(len(views)))
    count = int(rng.integers(4, 7))
    mixture = Mixture(folder, [])
    style = str(rng.choice(["plain", "two folders", "spaces", "decomposed", "long", "capitals"]))
    mixture.kinds.add(f"names: {style}")
    # A program that ignores EXIF can use rotated photos, and no mirrored ones.
    orientations = [[1], [1, 3, 6, 8], [1, 2, 3, 4, 5, 6, 7, 8]][int(rng.choice(3, p=[0.4, 0.4, 0.2]))]
    for index in range(count):
        view = views[(first + index) % len(views)]
        with Image.open(_ROOM / "photos" / view["file"]) as image:
            picture, focal = image.convert("RGB"), view["params"]["f"] * WIDTH / view["width"]
        if rng.random() < 0.15:
            mixture.kinds.add("zoom")
            w, h = picture.size
            picture, focal = picture.crop((w // 4, h // 4, w - w // 4, h - h // 4)), focal * 2
        picture = picture.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
        kind = str(rng.choice(list(_SUFFIXES)))
        orientation = int(rng.choice(orientations)) if kind in ("JPEG", "PNG", "WebP") else 1
        if orientation > 1:
            mixture.kinds.add("EXIF rotation" if orientation in (3, 6, 8) else "EXIF mirroring")
        suffix = _SUFFIXES[kind]
        if rng.random() < 0.15:
            suffix = str(rng.choice([".jpg", ".heic", ".png", ".tif"]))
            mixture.kinds.add("wrong suffix")
        mixture.kinds.add(kind)
        name = _name(style, index) + (suffix.upper() if style == "capitals" else suffix)
        _written(folder / name, _encoded(picture, kind, orientation, rng))
        viewmat = np.array(view["world_to_camera"], np.float64)
        mixture.shots.append(Shot([name], np.asarray(picture), viewmat, focal, orientation))
    for add in (_copies, _masks, _system_folders, _no_photos):
        if rng.random() < 0.45:
            add(mixture, rng)
    return mixture


def _name(style: str, index: int) -> str:
    return {
        "plain": f"IMG_{index:04d}",
        "two folders": f"cam{index % 2 + 1}/{index // 2:04d}",
        "spaces": f"Saal 1/vase neu ({index})",
        "decomposed": unicodedata.normalize("NFD", f"Büste/é {index}"),
        "long": f"{index}" + "ü" * 118,
        "capitals": f"DCIM/DSC_{index:04d}",
    }[style]


def _written(file: Path, data: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(data)


def _encoded(picture: Image.Image, kind: str, orientation: int, rng: np.random.Generator) -> bytes:
    stream = io.BytesIO()
    turn = _STORED[orientation]
    stored = picture if turn is None else picture.transpose(turn)
    exif = Image.Exif()
    if orientation > 1:
        exif[_ORIENTATION] = orientation
    if kind == "HEIC":
        pillow_heif.from_pillow(stored).save(stream, quality=90)
    elif kind.startswith("TIFF"):
        pixels = np.asarray(stored)
        if kind == "TIFF 16 bits":
            pixels = pixels.astype(np.uint16) * 257
        planar = rng.random() < 0.4
        options: dict[str, Any] = {"tile": (64, 64)} if rng.random() < 0.4 else {"rowsperstrip": 32}
        tifffile.imwrite(
            stream,
            np.ascontiguousarray(pixels.transpose(2, 0, 1)) if planar else pixels,
            photometric="rgb",
            planarconfig="separate" if planar else "contig",
            byteorder=str(rng.choice(["<", ">"])),
            compression=None if rng.random() < 0.5 else "zlib",
            **options,
        )
    else:
        stored.save(stream, kind, quality=int(rng.integers(85, 96)), exif=exif)
    return stream.getvalue()


def _copies(mixture: Mixture, rng: np.random.Generator) -> None:
    """Add smaller copies in another folder, under the same names or others, with or without the rotation applied."""
    mixture.kinds.add("copies")
    renamed = rng.random() < 0.5
    for index, shot in enumerate(mixture.shots):
        picture = Image.fromarray(shot.pixels)
        scale = float(rng.uniform(0.6, 0.8))
        picture = picture.resize((round(WIDTH * scale), round(HEIGHT * scale)), Image.Resampling.BICUBIC)
        name = f"small/wa{index:03d}.jpg" if renamed else f"images_2/{Path(shot.names[0]).with_suffix('.jpg')}"
        _written(mixture.folder / name, _encoded(picture, "JPEG", 1, rng))
        mixture.told.append(name)


def _masks(mixture: Mixture, rng: np.random.Generator) -> None:
    mixture.kinds.add("masks")
    beside = rng.random() < 0.5
    for shot in mixture.shots:
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        x, y = rng.integers(20, 120), rng.integers(20, 80)
        mask[y : y + 120, x : x + 150] = 255
        stem = Path(shot.names[0]).with_suffix("")
        if beside and len(stem.name.encode()) > 200:
            continue
        name = f"{stem}_mask.png" if beside else f"masks/{stem}.png"
        _written(mixture.folder / name, _encoded(Image.fromarray(mask), "PNG", 1, rng))
        mixture.told.append(name)


def _system_folders(mixture: Mixture, rng: np.random.Generator) -> None:
    mixture.kinds.add("system folders")
    for name in ("@eaDir/a.jpg/SYNOPHOTO_THUMB_XL.jpg", ".thumbs/b.jpg", "__MACOSX/._c.jpg", "#recycle/d.jpg"):
        picture = Image.fromarray(mixture.shots[int(rng.integers(len(mixture.shots)))].pixels)
        _written(mixture.folder / name, _encoded(picture, "JPEG", 1, rng))


def _no_photos(mixture: Mixture, rng: np.random.Generator) -> None:
    """Add a panorama, a screenshot, the video of a Live Photo, a damaged photo, or a file of another kind."""
    for kind in rng.choice(["panorama", "screenshot", "Live Photo", "damaged", "float TIFF", "video", "GIF"], 2, False):
        mixture.kinds.add(str(kind))
        noise = rng.integers(0, 255, (30, 60, 3), np.uint8)
        picture = Image.fromarray(noise).resize((640, 320), Image.Resampling.BICUBIC)
        stream = io.BytesIO()
        name = f"other_{str(kind).replace(' ', '_')}"
        if kind == "panorama":
            picture.save(stream, "JPEG", xmp=b'<x GPano:ProjectionType="equirectangular"/>')
            name += ".jpg"
        elif kind == "screenshot":
            picture.save(stream, "PNG")
            name = "Screenshot 2024-05-01 at 10.00.00.png"
        elif kind == "damaged":
            picture.save(stream, "JPEG")
            stream = io.BytesIO(stream.getvalue()[: stream.tell() // 2])
            name += ".jpg"
        elif kind == "float TIFF":
            tifffile.imwrite(stream, np.asarray(picture, np.float32), photometric="rgb")
            name += ".tif"
        elif kind == "GIF":
            picture.save(stream, "GIF")
            name += ".jpg"
        else:
            stream.write(b"\0\0\0\x14ftypqt  \0\0\0\0qt  \0\0\0\x08mdat")
            name += ".mov"
            if kind == "Live Photo":
                name = str(Path(mixture.shots[0].names[0]).with_suffix(".MOV"))
        _written(mixture.folder / name, stream.getvalue())
        if kind != "Live Photo":
            mixture.told.append(name)
