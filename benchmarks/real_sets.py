"""Objects of real photo sets with hand-made masks: ``python -m benchmarks.real_sets --doc docs/objects.md``.

Each set is a folder of ``GAUSSIAN_HERITAGE_DATA`` with ``photos`` and ``masks/PHOTO_OBJECT.png``. It is reconstructed
with the preset `standard` below OUT, which a later run reuses. The first mask of an object, in the order of the photos'
names, is the prompt; the others score. The same masks score a click on its innermost pixel, the word for the object,
and what of *Find All* fits them best. The figures are *in sample*: constants of the method are chosen on these sets.
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
from engine.masks import iou, load_default_sam
from engine.objects import (
    ClickPrompt,
    MaskPrompt,
    Prompt,
    SegmentationContext,
    TextPrompt,
    find_everything,
    find_objects,
    load_context,
    photo_folder_of,
)
from engine.objects.grounding import load_default_detector
from engine.objects.settings import PRESETS
from engine.pictures import visible_masks
from engine.project.folder import ProjectFolder
from engine.quality.evaluation.comparison import Scores, score_photo
from engine.quality.evaluation.results import FOUND_IOU, WHOLE_IOU
from engine.quality.evaluation.settings import MARKS
from engine.quality.evaluation.trained_scene import innermost_pixel
from engine.scene import photos_called

from .documents import print_table
from .training.photo_sets import photo_set

SETS = ("skull66", "banana16", "meeting_place9", "herz_jesus25")
METHODS = ("paper", "released", "better")
PROMPTS = ("click", "word", "Find All")
"""What else `better` is asked by."""
_WORDS = {"bananas": "bananas", "door": "door", "noticeboard": "notice board"}
"""Words for objects, of those that the offline vocabulary knows."""
_PART = "real sets"


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

    @property
    def evidence(self) -> str:
        """The photo whose mask is the prompt."""
        return next(iter(self.files))

    @property
    def scored(self) -> tuple[str, ...]:
        """The photos whose masks score."""
        return tuple(self.files)[1:]

    def mask(self, photo: str) -> Mask:
        """Return the mask in a photo, bool [h, w]."""
        picture = cv2.imread(str(self.files[photo]), cv2.IMREAD_GRAYSCALE)
        if picture is None:
            raise FormatError(f"{self.files[photo]} cannot be read. Restore it.")
        return np.asarray(picture > 127)


@dataclass(frozen=True)
class Row:
    """Means over the scored photos of an object, by one method or prompt."""

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


def measured(name: str, out: Path, methods: Sequence[str] = METHODS, prompts: Sequence[str] = ()) -> Iterator[Row]:
    """Yield the figures of each object of a set by one mask with each method, and with `better` by each prompt."""
    project = reconstructed(name, out)
    for method, prompt in [*((method, "mask") for method in methods), *(("better", prompt) for prompt in prompts)]:
        context = load_context(project, PRESETS[method], load_default_detector, load_default_sam)
        everything = [one.members for one in find_everything(context)] if prompt == "Find All" else []
        for truth in true_masks(name, list(context.views.cameras.by_photo)):
            started = time.process_time()
            if prompt == "Find All":
                members = _fitting(context, everything, truth)
            else:
                members = _answer(context, _prompt(truth, prompt))
            seconds = time.process_time() - started
            scores = 100 * np.mean(_scores(context, members, truth, photo_folder_of(project)), axis=0)
            figures = Scores(*scores.tolist())
            yield Row(
                name, truth.name, method if prompt == "mask" else prompt, figures.iou, figures.boundary_iou,
                figures.halo, figures.stray, figures.holes, len(truth.scored), seconds,
            )  # fmt: skip


def _prompt(truth: TrueMasks, kind: str) -> Prompt | None:
    """Return the prompt for an object, None where there is no word for it."""
    if kind == "word":
        return TextPrompt(_WORDS[truth.name]) if truth.name in _WORDS else None
    if kind == "click":
        y, x = innermost_pixel(truth.mask(truth.evidence))
        return ClickPrompt(truth.evidence, x, y)
    return MaskPrompt(truth.evidence, truth.files[truth.evidence])


def _answer(context: SegmentationContext, prompt: Prompt | None) -> Mask | None:
    """Return the Gaussians of the first answer, [N]; None if there is none."""
    if prompt is None:
        return None
    try:
        return find_objects(context, prompt)[0].members
    except PromptError:
        return None


def _fitting(context: SegmentationContext, found: Sequence[Mask], truth: TrueMasks) -> Mask | None:
    """Return which of the sets of Gaussians fits the scored masks best; None where there is none."""
    if not found:
        return None
    overlaps = [
        [iou(shown, truth.mask(photo)) for shown in
         visible_masks(context.views.scene, context.views.cameras.by_photo[photo], found)]
        for photo in truth.scored
    ]  # fmt: skip
    return found[int(np.mean(overlaps, axis=0).argmax())]


def _scores(context: SegmentationContext, members: Mask | None, truth: TrueMasks, folder: Path) -> list[Scores]:
    camera_of, scene = context.views.cameras.by_photo, context.views.scene
    return [
        score_photo(scene, camera_of[photo], folder / photo, [members], [truth.mask(photo)])[0]
        for photo in truth.scored
    ]  # fmt: skip


def table(rows: Sequence[Row], columns: Sequence[str]) -> str:
    """Return the Markdown table: IoU / BIoU of each object in each column, their means, how many are found and whole.

    Halo, stray and holes are those of `better`, if it is a column, else of the last one.
    """
    lines = [
        f"| set | object | views | {' | '.join(columns)} | halo | stray | holes |",
        f"| --- | --- |{' ---: |' * (len(columns) + 4)}",
    ]
    objects = list(dict.fromkeys((row.photo_set, row.object) for row in rows))
    by = {(row.photo_set, row.object, row.method): row for row in rows}
    for photo_set_name, thing in objects:
        own = {column: by[photo_set_name, thing, column] for column in columns}
        cells = " | ".join(
            "no word" if column == "word" and thing not in _WORDS else f"{row.iou:.1f} / {row.boundary_iou:.1f}"
            for column, row in own.items()
        )
        told = own["better" if "better" in columns else columns[-1]]
        rest = f"{told.halo:.1f} | {told.stray:.1f} | {told.holes:.1f}"
        lines.append(f"| {photo_set_name} | {thing} | {told.n_views} | {cells} | {rest} |")
    means, counts = [], []
    for column in columns:
        mine = [row for row in rows if row.method == column and (column != "word" or row.object in _WORDS)]
        sets = [[row for row in mine if row.photo_set == name] for name in dict.fromkeys(row.photo_set for row in mine)]
        overlap, boundary = (
            np.mean([np.mean([getattr(row, figure) for row in one]) for one in sets])
            for figure in ("iou", "boundary_iou")
        )
        means.append(f"{overlap:.1f} / {boundary:.1f}")
        found, whole = (sum(row.iou >= 100 * least for row in mine) for least in (FOUND_IOU, WHOLE_IOU))
        counts.append(f"{found}, {whole} of {len(mine)}")
    lines.append(f"| **mean of the sets** | | | {' | '.join(means)} | | | |")
    lines.append(f"| **found, whole** | | | {' | '.join(counts)} | | | |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the sets and print the table, or write it into a document."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_sets", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/real_sets"), help="(default: %(default)s)")
    parser.add_argument("--sets", default=",".join(SETS), help="(default: %(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the table into this file")
    options = parser.parse_args(arguments)
    rows = [row for name in options.sets.split(",") for row in measured(name, options.out, METHODS, PROMPTS)]
    print_table(table(rows, [*METHODS, *PROMPTS]), options.doc, _PART, MARKS["in sample"])
    return 0


if __name__ == "__main__":
    sys.exit(main())
