"""CPU time of reading the same photos as JPEG and as HEIC: docs/photos.md.

The photos are pictures of the demo room, enlarged to 12 megapixels, with the noise of a sensor and the colour profile
of a phone. HEIC is written in tiles of 512 pixels, as phones do.

example: python -m benchmarks.photo_reading --count 10 --out docs/photos.md
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageCms

from engine.photos import load_pixels, read_photos
from engine.photos.settings import PhotoSettings

from .documents import put_into

__all__ = ["main"]

_SOURCES = Path(__file__).resolve().parents[1] / "demo" / "museum_room" / "photos"
_SIZE = (4032, 3024)
_NOISE = 1.5
"""Standard deviation of the noise in levels of 255."""
_FORMATS: dict[str, dict[str, Any]] = {
    "JPEG": {"format": "JPEG", "quality": 92},
    "HEIC": {"format": "HEIF", "quality": 60, "tile_size": 512},
}
_PART = "reading"


def main() -> None:
    """Write the photos, read them in turns, and print the table or put it into a document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10, help="number of photos")
    parser.add_argument("--rounds", type=int, default=3, help="how often each is read; the smallest time counts")
    parser.add_argument("--out", type=Path, help="document that gets the table")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write(folder, options.count)
        seconds = {kind: _seconds(folder / kind, options.rounds) for kind in _FORMATS}
        sizes = {kind: sum(file.stat().st_size for file in (folder / kind).iterdir()) for kind in _FORMATS}
    rows = [
        f"| {kind} | {sizes[kind] / options.count / 1e6:.1f} | {read:.2f} | {load:.2f} | "
        f"{read / seconds['JPEG'][0]:.2f} | {load / seconds['JPEG'][1]:.2f} |"
        for kind, (read, load) in seconds.items()
    ]
    table = "\n".join([
        "| format | MB | s to check | s to load at 1,600 px | check, of JPEG | load, of JPEG |",
        "| --- | --- | --- | --- | --- | --- |",
        *rows,
    ])  # fmt: skip
    if options.out is None:
        print(table)
    else:
        put_into(options.out, _PART, table)


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


def _seconds(folder: Path, rounds: int) -> tuple[float, float]:
    """Return the CPU seconds for a photo: to check it as `reconstruct` does first, and to load it reduced."""
    files = sorted(folder.iterdir())
    checks, loads = [], []
    for _ in range(rounds):
        start = _cpu()
        read_photos(folder, PhotoSettings())
        checks.append((_cpu() - start) / len(files))
        each = []
        for file in files:
            start = _cpu()
            load_pixels(file, max_side=1600)
            each.append(_cpu() - start)
        loads.append(statistics.mean(each))
    return min(checks), min(loads)


def _cpu() -> float:
    """Return the CPU seconds of this process and of its children that have ended."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


if __name__ == "__main__":
    main()
