"""Memory and time of the label maps of a project with many photos: ``python -m benchmarks.scale.label_maps``.

The maps are made: segments with ragged borders, 22 runs of equal labels in a row; SAM's maps of the museum room have 15
to 19. All are read once, as the digest of the scene's graph does, then those of the graph and of twenty prompts.

example: python -m benchmarks.scale.label_maps --maps 1000 --out out/label_maps --doc docs/many_photos.md
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from engine.core.arrays import Int32
from engine.core.files import read_json, write_json
from engine.core.system import describe_machine, peak_memory
from engine.masks import label_map_path, read_label_map
from engine.masks.storage import write_label_map
from engine.objects import label_maps_of
from engine.objects.settings import BETTER
from engine.scene import Camera, CameraSet
from engine.training.losses import drawn_pixels, labelled_pixels
from engine.training.settings import PRESETS

from ..documents import put_into

_WIDTH, _HEIGHT = 1024, 768
"""Of the label map of a photo of 4000 x 3000 pixels."""
_CARD_WIDTH, _CARD_HEIGHT = 1600, 1200
"""Of a picture that a card trains on."""
_SEGMENTS = 12
"""Segments beside each other."""
_DIFFERENT = 50
"""Maps that are made; the others are copies of them, which take as long to read."""
_PROMPTS = 20
_DRAWS = 500


def make_map(number: int, width: int = _WIDTH, height: int = _HEIGHT) -> Int32:
    """Return a label map of squares with ragged borders, of which every seventh has no label."""
    rng = np.random.default_rng(number)
    side = width / _SEGMENTS
    y, x = np.mgrid[:height, :width]
    shift = np.cumsum(rng.normal(0, 1, max(width, height)))
    columns = ((x + shift[:height, None]) // side).astype(np.int32) + 8
    rows = ((y + shift[None, :width]) // side).astype(np.int32) + 8
    labels = columns + 40 * rows
    return np.where(labels % 7 == number % 7, 0, labels).astype(np.int32)


def cameras_of(count: int) -> CameraSet:
    """Return cameras of so many photos."""
    one = Camera("", 4000, 3000, "PINHOLE", (3000.0, 3000.0, 2000.0, 1500.0), np.eye(4))
    photos = tuple(replace(one, photo=f"{number:04d}.jpg") for number in range(count))
    return CameraSet(photos, (), np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), 0.5, np.eye(4), True)


class _All(Mapping[str, Int32]):
    """Every map that was read, as they were kept before."""

    def __init__(self, project: Path, cameras: CameraSet) -> None:
        self._files = {camera.photo: label_map_path(project / "masks", camera.photo) for camera in cameras.cameras}
        self._read: dict[str, Int32] = {}

    def __getitem__(self, photo: str) -> Int32:
        if photo not in self._read:
            self._read[photo] = read_label_map(self._files[photo])
        return self._read[photo]

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


def read_all(project: Path, count: int, *, keeps_all: bool) -> dict[str, float]:
    """Return the growth of this process's peak memory in bytes and the CPU seconds of reading the maps of a project."""
    cameras = cameras_of(count)
    maps = _All(project, cameras) if keeps_all else label_maps_of(project, cameras)
    names, rng = list(maps), np.random.default_rng(0)
    before, begin, total = peak_memory(), time.process_time(), 0
    for name in names:
        total += int(maps[name][0, 0])
    for name in names[:: max(1, count // BETTER.n_vote_views)]:
        total += int(maps[name][0, 0])
    for number in rng.integers(0, count, _PROMPTS * BETTER.n_text_views):
        total += int(maps[names[number]][0, 0])
    return {"bytes": peak_memory() - before, "cpu": time.process_time() - begin}


def of_training() -> dict[str, float]:
    """Return bytes of a photo's labels in training on a card, as arrays and as runs, and ms of a draw from them."""
    labels = make_map(0, _CARD_WIDTH, _CARD_HEIGHT)
    pixels = labelled_pixels(labels, min_pixels=100)
    assert pixels is not None
    index, cluster = pixels.at(np.arange(len(pixels)))
    n_samples, generator = PRESETS["standard"].features.clustering_pixels, torch.Generator().manual_seed(0)
    begin = time.process_time()
    for _ in range(_DRAWS):
        drawn_pixels(pixels, n_samples, generator)
    by_runs, begin = time.process_time() - begin, time.process_time()
    for _ in range(_DRAWS):
        numbers = torch.randint(len(index), (n_samples,), generator=generator)
        index[numbers], cluster[numbers]
    by_arrays = time.process_time() - begin
    runs = pixels.ends.nbytes + pixels.offset.nbytes + pixels.cluster.nbytes
    return {
        "arrays": labels.nbytes + index.nbytes + cluster.nbytes, "runs": runs + 8 * len(pixels.ends),
        "arrays_ms": 1e3 * by_arrays / _DRAWS, "runs_ms": 1e3 * by_runs / _DRAWS,
    }  # fmt: skip


def table(count: int, stored: int, before: dict[str, float], after: dict[str, float], step: dict[str, float]) -> str:
    """Return the table of what was measured."""
    features = PRESETS["standard"].features
    return "\n".join([
        f"Made by `python -m benchmarks.scale.label_maps`: {count:,} label maps of {_WIDTH} x {_HEIGHT} pixels, as "
        f"of photos of 12 megapixels, {stored / 1e6:.0f} MB on disk. All are read once, {BETTER.n_vote_views} again "
        f"for the graph, and {BETTER.n_text_views} for each of {_PROMPTS} prompts. {describe_machine().name}.",
        "",
        "| | all kept as arrays, before | runs of those used last |",
        "| --- | ---: | ---: |",
        f"| objects: memory of the maps, MB | {before['bytes'] / 1e6:.0f} | {after['bytes'] / 1e6:.0f} |",
        f"| objects: CPU s | {before['cpu']:.1f} | {after['cpu']:.1f} |",
        f"| training on a card: MB for the labels of a photo of {_CARD_WIDTH} x {_CARD_HEIGHT} pixels "
        f"| {step['arrays'] / 1e6:.1f} | {step['runs'] / 1e6:.1f} |",
        f"| training: CPU ms of drawing pixels of segments, every {features.clustering_interval} steps "
        f"| {step['arrays_ms']:.2f} | {step['runs_ms']:.2f} |",
        "",
    ])  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the maps, measure in processes of their own, and print the table or write it into a document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", type=int, default=1000, help="default: %(default)s")
    parser.add_argument("--out", type=Path, default=Path("out/label_maps"), help="folder (default: %(default)s)")
    parser.add_argument(
        "--doc", type=Path, help="document whose part `label maps` is replaced; by default it is printed"
    )
    parser.add_argument("--read", choices=("all", "runs"), help="only read the maps in this way, into OUT/WAY.json")
    options = parser.parse_args(arguments)
    if options.read:
        write_json(
            options.out / f"{options.read}.json", read_all(options.out, options.maps, keeps_all=options.read == "all")
        )
        return 0
    files = [label_map_path(options.out / "masks", camera.photo) for camera in cameras_of(options.maps).cameras]
    for number, file in enumerate(files):
        if number < _DIFFERENT:
            write_label_map(file, make_map(number))
        else:
            shutil.copyfile(files[number % _DIFFERENT], file)
    found = []
    for way in ("all", "runs"):
        command = [sys.executable, "-m", __spec__.name, "--read", way]
        subprocess.run([*command, "--maps", str(options.maps), "--out", str(options.out)], check=True)
        found.append(read_json(options.out / f"{way}.json", {"bytes": int, "cpu": float}, advice=""))
    text = table(options.maps, sum(file.stat().st_size for file in files), *found, of_training())
    if options.doc is None:
        sys.stdout.write(text)
    else:
        put_into(options.doc, "label maps", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
