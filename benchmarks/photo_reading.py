"""CPU time of reading the same photos as JPEG and as HEIC, for docs/photos.md and docs/design_notes/photos.md.

The photos are pictures of the demo room, enlarged to 12 megapixels, with the noise of a sensor and the colour profile
of a phone. HEIC is written in tiles of 512 pixels, as phones do.

Kinds are measured in turns, and ratios within one turn: other programs slow all kinds down alike.

example: python -m benchmarks.photo_reading --count 2 --rounds 15 --out docs/photos.md
"""

from __future__ import annotations

import argparse
import hashlib
import os
import statistics
import tempfile
import time
import unittest.mock
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageCms

from engine.photos import heic_tiles, load_pixels, read_photos
from engine.photos.pixels import open_photo, upright_strips
from engine.photos.reading import _gray_for_measuring, measure_photo
from engine.photos.settings import PhotoSettings

from .documents import print_table
from .places import ROOT

_SOURCES = ROOT / "demo" / "museum_room" / "photos"
_SIZE = (4032, 3024)
_NOISE = 1.5
"""Standard deviation of the noise in levels of 255."""
_FORMATS: dict[str, dict[str, Any]] = {
    "JPEG": {"format": "JPEG", "quality": 92},
    "HEIC": {"format": "HEIF", "quality": 60, "tile_size": 512},
}
_LIBHEIF = "HEIC, libheif alone"
"""The same HEIC files without FFmpeg."""
_KINDS = ("JPEG", "HEIC", _LIBHEIF)
_READING, _PARTS = "reading", "heic_parts"
_ROUNDS_OF_PARTS = 3


def main() -> None:
    """Write the photos, read them in turns, and print the tables or put them into documents."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10, help="number of photos")
    parser.add_argument("--rounds", type=int, default=3, help="how often each is read")
    parser.add_argument("--out", type=Path, help="document that gets the first table")
    parser.add_argument("--parts", type=Path, help="document that gets the table of the parts")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write(folder, options.count)
        sizes = {kind: sum(file.stat().st_size for file in _files(folder, kind)) for kind in _KINDS}
        rounds = [{kind: _measured(folder, kind, _reading) for kind in _KINDS} for _ in range(options.rounds)]
        few = range(min(options.rounds, _ROUNDS_OF_PARTS))
        parts = [{kind: _measured(folder, kind, _parts_of) for kind in _KINDS} for _ in few]
    tables = ((options.out, _READING, _table(sizes, rounds, options.count)), (options.parts, _PARTS, _parts(parts)))
    for document, part, table in tables:
        print_table(table, document, part)


def _table(sizes: dict[str, int], rounds: list[dict[str, dict[str, float]]], count: int) -> str:
    rows = []
    for kind in _KINDS:
        check, load = (min(one[kind][what] for one in rounds) for what in ("check", "load"))
        ratios = [
            statistics.median(one[kind][what] / one["JPEG"][what] for one in rounds) for what in ("check", "load")
        ]
        rows.append(
            f"| {kind} | {sizes[kind] / count / 1e6:.1f} | {check:.2f} | {load:.2f} | {ratios[0]:.2f} | "
            f"{ratios[1]:.2f} |"
        )
    return "\n".join([
        "| format | MB | s to check | s to load at 1,600 px | check, of JPEG | load, of JPEG |",
        "| --- | --- | --- | --- | --- | --- |",
        *rows,
    ])  # fmt: skip


def _parts(rounds: list[dict[str, dict[str, float]]]) -> str:
    rows = [
        f"| {name} | " + " | ".join(f"{1000 * min(one[kind][name] for one in rounds):.0f}" for kind in _KINDS) + " |"
        for name in rounds[0]["JPEG"]
    ]
    return "\n".join([f"| part | {' | '.join(_KINDS)} |", "| --- |" + " --- |" * len(_KINDS), *rows])


def _files(folder: Path, kind: str) -> list[Path]:
    return sorted((folder / ("JPEG" if kind == "JPEG" else "HEIC")).iterdir())


def _write(folder: Path, count: int) -> None:
    from engine.photos.heic import can_read_heic

    can_read_heic()
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    # Another description, so that the conversion of a phone's colours is done and timed.
    profile = profile.replace("sRGB".encode("utf-16-be"), "Phon".encode("utf-16-be")).replace(b"sRGB", b"Phon")
    sources = sorted(_SOURCES.glob("*.jpg"))
    for kind in _FORMATS:
        (folder / kind).mkdir()
    for number in range(count):
        with Image.open(sources[number % len(sources)]) as source:
            large = np.asarray(source.convert("RGB").resize(_SIZE, Image.Resampling.BICUBIC))
        noise = np.random.default_rng(number).normal(0.0, _NOISE, large.shape)
        picture = Image.fromarray(np.clip(np.rint(large + noise), 0, 255).astype(np.uint8))
        for kind, options in _FORMATS.items():
            picture.save(folder / kind / f"{number:03d}.{kind.lower()}", icc_profile=profile, **options)


def _measured(folder: Path, kind: str, measure: Callable[[list[Path]], dict[str, float]]) -> dict[str, float]:
    decode = (lambda picture: None) if kind == _LIBHEIF else heic_tiles._pixels_of
    with unittest.mock.patch.object(heic_tiles, "_pixels_of", decode):
        return measure(_files(folder, kind))


def _reading(files: list[Path]) -> dict[str, float]:
    """Return the CPU seconds for a photo: to check it as `reconstruct` does first, and to load it reduced."""
    return {
        "check": _seconds_of(lambda: read_photos(files[0].parent, PhotoSettings())) / len(files),
        "load": statistics.mean(_seconds_of(lambda file=file: load_pixels(file, max_side=1600)) for file in files),
    }


def _parts_of(files: list[Path]) -> dict[str, float]:
    """Return the CPU seconds for a photo of the parts of a check that take most of it."""
    parts = [_parts_of_one(file) for file in files]
    return {name: statistics.mean(part[name] for part in parts) for name in parts[0]}


def _parts_of_one(file: Path) -> dict[str, float]:
    image, strips = open_photo(file)[0], []
    step = round(max(image.size) / 800)
    seconds = {
        "decode": _seconds_of(lambda: open_photo(file)),
        "colour profile to sRGB": _seconds_of(lambda: strips.extend(upright_strips(image, step))),
        "hash of the pixels": _seconds_of(lambda: [hashlib.blake2b(strip.data) for strip in strips]),
        "brightness, reduced": _seconds_of(lambda: [_gray_for_measuring(strip, step) for strip in strips]),
    }
    seconds["all of the check"] = _seconds_of(lambda: measure_photo(str(file)))
    return seconds


def _seconds_of(action: Callable[[], object]) -> float:
    start = _cpu()
    action()
    return _cpu() - start


def _cpu() -> float:
    """Return the CPU seconds of this process and of its children that have ended."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


if __name__ == "__main__":
    main()
