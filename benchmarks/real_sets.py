"""Objects of real photo sets by one hand-made mask: ``python -m benchmarks.real_sets --doc docs/segmentation.md``.

Each set is a folder of ``GAUSSIAN_HERITAGE_DATA`` with ``photos`` and ``masks/PHOTO_OBJECT.png``. It is reconstructed
with the preset `standard` below OUT, which a later run reuses. The first mask of an object, in the order of the photos'
names, is the prompt; the others score. The figures are *in sample*: constants of the method are chosen on these sets.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from engine.core.arrays import Mask
from engine.core.errors import FormatError, PromptError
from engine.masks import load_default_sam
from engine.objects import MaskPrompt, find_objects, load_context, photo_folder_of
from engine.objects.grounding import load_default_detector
from engine.objects.settings import PRESETS
from engine.project.folder import ProjectFolder
from engine.quality.evaluation.comparison import Scores, score_photo
from engine.quality.evaluation.results import WHOLE_IOU
from engine.quality.evaluation.settings import MARKS
from engine.scene import photos_called

from .documents import print_table
from .training.photo_sets import photo_set

SETS = ("skull66", "banana16", "meeting_place9", "herz_jesus25")
_PART = "real sets by mask"


@dataclass(frozen=True)
class TrueMasks:
    """Hand-made masks of an object.

    Attributes
    ----------
    photo_set, name : str
    files : dict of str to Path
        By photo, in the order of their names.
    """

    photo_set: str
    name: str
    files: dict[str, Path]

    def mask(self, photo: str) -> Mask:
        """Return the mask in a photo, bool [h, w]."""
        picture = cv2.imread(str(self.files[photo]), cv2.IMREAD_GRAYSCALE)
        if picture is None:
            raise FormatError(f"{self.files[photo]} cannot be read. Restore it.")
        return np.asarray(picture > 127)


@dataclass(frozen=True)
class Row:
    """Means over the scored photos of an object, by one method."""

    photo_set: str
    object: str
    method: str
    iou: float
    boundary_iou: float
    halo: float
    stray: float
    holes: float
    n_views: int
    cpu_seconds: float


def true_masks(name: str, photos: Sequence[str]) -> list[TrueMasks]:
    """Return the masks of a set by object, of those photos that have a camera."""
    found: dict[str, dict[str, Path]] = {}
    for file in sorted((photo_set(name).photos.parent / "masks").glob("*.png")):
        photo, _, thing = file.stem.rpartition("_")
        if same := photos_called(photo, photos):
            found.setdefault(thing, {})[same[0]] = file
    return [TrueMasks(name, thing, files) for thing, files in found.items() if len(files) > 1]


def reconstructed(name: str, out: Path) -> ProjectFolder:
    """Return the trained project of a set; a run that was stopped is continued."""
    folder = out / name / "project"
    command = [sys.executable, "-m", "engine", "reconstruct", photo_set(name).photos, "--out", folder]
    command += ["--preset", "standard", "--until", "training", "--device", "cpu"]
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
    return ProjectFolder.open_existing(folder)


def measured(name: str, out: Path, methods: Sequence[str]) -> Iterator[Row]:
    """Yield the figures of each object of a set by each method."""
    project = reconstructed(name, out)
    folder = photo_folder_of(project)
    for method in methods:
        context = load_context(project, PRESETS[method], load_default_detector, load_default_sam)
        camera_of = context.views.cameras.by_photo
        for truth in true_masks(name, list(camera_of)):
            evidence, *others = truth.files
            started = time.process_time()
            try:
                (found, *_) = find_objects(context, MaskPrompt(evidence, truth.files[evidence]))
                members = found.members
            except PromptError:
                members = None
            seconds = time.process_time() - started
            scores = Scores(*np.mean([
                score_photo(context.views.scene, camera_of[photo], folder / photo, [members],
                            [truth.mask(photo)])[0]
                for photo in others
            ], axis=0))  # fmt: skip
            yield Row(
                name, truth.name, method, 100 * scores.iou, 100 * scores.boundary_iou, 100 * scores.halo,
                100 * scores.stray, 100 * scores.holes, len(others), seconds,
            )  # fmt: skip


def table(rows: Sequence[Row], methods: Sequence[str]) -> str:
    """Return the Markdown table: IoU / BIoU of each object by each method, their means, and how many are whole."""
    lines = [
        f"| set | object | views | {' | '.join(methods)} | halo | stray | holes |",
        f"| --- | --- |{' ---: |' * (len(methods) + 4)}",
    ]
    objects = list(dict.fromkeys((row.photo_set, row.object) for row in rows))
    by = {(row.photo_set, row.object, row.method): row for row in rows}
    for photo_set_name, thing in objects:
        own = [by[photo_set_name, thing, method] for method in methods]
        cells = " | ".join(f"{row.iou:.1f} / {row.boundary_iou:.1f}" for row in own)
        last = own[-1]
        rest = f"{last.halo:.1f} | {last.stray:.1f} | {last.holes:.1f}"
        lines.append(f"| {photo_set_name} | {thing} | {last.n_views} | {cells} | {rest} |")
    means, whole = [], []
    for method in methods:
        mine = [row for row in rows if row.method == method]
        sets = [[row for row in mine if row.photo_set == name] for name in dict.fromkeys(row.photo_set for row in mine)]
        iou, boundary = (
            np.mean([np.mean([getattr(row, figure) for row in one]) for one in sets])
            for figure in ("iou", "boundary_iou")
        )
        means.append(f"{iou:.1f} / {boundary:.1f}")
        whole.append(f"{sum(row.iou >= 100 * WHOLE_IOU for row in mine)} of {len(mine)}")
    lines.append(f"| **mean of the sets** | | | {' | '.join(means)} | | | |")
    lines.append(f"| **whole** | | | {' | '.join(whole)} | | | |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the sets and print the table, or write it into a document."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_sets", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/real_sets"), help="(default: %(default)s)")
    parser.add_argument("--sets", default=",".join(SETS), help="(default: %(default)s)")
    parser.add_argument("--methods", default="paper,released,better", help="(default: %(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the table into this file")
    options = parser.parse_args(arguments)
    methods = options.methods.split(",")
    rows = [row for name in options.sets.split(",") for row in measured(name, options.out, methods)]
    print_table(table(rows, methods), options.doc, _PART, MARKS["in sample"])
    return 0


if __name__ == "__main__":
    sys.exit(main())
