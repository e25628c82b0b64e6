"""CPU seconds of segmenting photos, and how well the segments fit the true masks of objects.

    python -m benchmarks.masks demo/museum_room out/kept/room_1 --every 4

Each folder has ``photos`` and may have ``truth`` in the layout of the museum room. Photos are segmented by the masks
stage of this working tree; to compare two methods, run it in two checkouts.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from engine.core.events import Event, Progress, never_stop
from engine.core.files import file_sha256
from engine.core.system import cpu_seconds
from engine.masks import label_map_path, load_default_sam, make_masks, read_label_map
from engine.masks.settings import MaskSettings
from engine.quality.evaluation.ground_truth import read_ground_truth
from engine.scene import Photo, PhotoSet

_MIN_PIXELS = 150
"""Smaller true masks are not counted."""
_MIN_INSIDE = 0.5
"""Smallest share of a segment inside of an object that it is counted as a part of."""


@dataclass(frozen=True)
class _Result:
    """CPU and wall seconds per photo, and the agreement of each object in each photo: best segment, best union."""

    cpu: list[float]
    wall: float
    n_segments: list[int]
    agreement: NDArray[np.float64]


def main() -> None:
    """Print one row of a Markdown table per folder, and one for all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--every", type=int, default=1, help="use every n-th photo only")
    options = parser.parse_args()
    print("| photos of | photos | CPU s, median | wall s, mean | segments | objects | best segment | best union |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    results = []
    for folder in options.folders:
        results.append(_measure(folder, options.every))
        print(_row(folder.name, results[-1:]), flush=True)
    print(_row("all", results))


def _measure(folder: Path, every: int) -> _Result:
    names = sorted(path.name for path in (folder / "photos").iterdir() if path.suffix == ".jpg")[::every]
    photos = tuple(_photo(folder / "photos", name) for name in names)
    times: list[float] = []

    def note(event: Event) -> None:
        if isinstance(event, Progress) and event.message != sam.device:
            times.append(cpu_seconds())

    sam = load_default_sam()
    with tempfile.TemporaryDirectory() as out:
        start = time.perf_counter()
        make_masks(
            PhotoSet(folder / "photos", photos, ()), names, Path(out), MaskSettings(), lambda: sam,
            emit=note, should_stop=never_stop,
        )  # fmt: skip
        wall = (time.perf_counter() - start) / len(names)
        labels = {name: read_label_map(label_map_path(Path(out), name)) for name in names}
    agreement = _agreement(folder / "truth", labels) if (folder / "truth").is_dir() else []
    return _Result(
        np.diff(times).tolist(), wall, [int(each.max()) for each in labels.values()], np.reshape(agreement, (-1, 2))
    )


def _photo(folder: Path, name: str) -> Photo:
    height, width = cv2.imread(str(folder / name)).shape[:2]
    return Photo(name, width, height, None, file_sha256(folder / name))


def _agreement(truth_folder: Path, labels: dict[str, NDArray[np.int32]]) -> list[tuple[float, float]]:
    """Return for each object in each photo the IoU of the best segment, and of all segments that lie mostly inside."""
    truth = read_ground_truth(truth_folder, list(labels))
    found = []
    for name in truth.photos:
        areas = np.bincount(labels[name].ravel())[1:]
        for mask in truth.masks(name).values():
            size = labels[name].shape[::-1]
            inside = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
            area = np.count_nonzero(inside)
            if area < _MIN_PIXELS:
                continue
            shared = np.bincount(labels[name][inside], minlength=len(areas) + 1)[1:]
            best = float((shared / (areas + area - shared)).max(initial=0.0))
            parts = shared > _MIN_INSIDE * areas
            union = shared[parts].sum() / (area + areas[parts].sum() - shared[parts].sum())
            found.append((best, float(union)))
    return found


def _row(name: str, results: list[_Result]) -> str:
    cpu = [seconds for result in results for seconds in result.cpu]
    wall = np.average([result.wall for result in results], weights=[len(result.cpu) for result in results])
    segments = np.mean([number for result in results for number in result.n_segments])
    agreement = np.concatenate([result.agreement for result in results])
    best, union = (f"{value:.3f}" for value in agreement.mean(axis=0)) if len(agreement) else ("", "")
    return (
        f"| {name} | {len(cpu)} | {np.median(cpu):.2f} | {wall:.2f} | {segments:.1f} | {len(agreement)} | "
        f"{best} | {union} |"
    )


if __name__ == "__main__":
    main()
