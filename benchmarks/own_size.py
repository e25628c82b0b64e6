"""Detail of objects at the photos' own size: ``make bench-detail``.

The objects are those of `benchmarks.real_sets`, found by one hand-made mask in the scenes that it trains, and those
that are stored in the projects named by ``--project``. No photo that is compared was trained on.

example: python -m benchmarks.own_size --doc docs/detail.md
         python -m benchmarks.own_size --sets "" --project out/monstree/project --picture tree.jpg
"""

from __future__ import annotations

import argparse
import pickle
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from PIL import Image

from engine.core.arrays import Mask
from engine.core.events import never_stop
from engine.core.system import PeakMemory
from engine.masks import load_default_sam
from engine.objects import DetailPhotos, MaskPrompt, Views, detail_object, erode_mask, find_objects, load_context
from engine.objects.grounding import load_default_detector
from engine.objects.settings import BETTER
from engine.pictures import Scene
from engine.project.folder import ProjectFolder
from engine.project.objects import list_objects, load_membership
from engine.scene import Gaussians, PinholeCamera

from .detail import EDGE_WIDTH, NOTICED, gradient_energy, photo_at_own_size, rendered, share_of_needles
from .documents import print_table
from .real_sets import SETS, reconstructed, true_masks

_MIN_SHARE = 0.5
"""Share of a pixel that the object contributes to the scene, from which on the pixel is compared."""
_MIN_PIXELS = 5_000
"""Smallest part of a photo that is compared, in pixels."""


@dataclass(frozen=True)
class Found:
    """An object of a trained project.

    Attributes
    ----------
    photo_set, name : str
    views : Views
    photos : DetailPhotos
    members : array of shape [N], bool
    """

    photo_set: str
    name: str
    views: Views
    photos: DetailPhotos
    members: Mask

    def trained(self) -> Gaussians:
        """Return its Gaussians as they are in the scene."""
        return replace(self.views.scene.gaussians[self.members], features=None)


@dataclass(frozen=True)
class Figures:
    """Figures of an object; each pair as in the scene and with detail."""

    name: str
    size: tuple[int, int]
    n_photos: int
    psnr: tuple[float, float]
    sharp: tuple[float, float]
    needles: tuple[float, float]
    n_gaussians: tuple[int, int]
    scale: float
    cpu_seconds: float
    memory: float

    @property
    def change(self) -> float:
        """Gain of PSNR, dB."""
        return self.psnr[1] - self.psnr[0]


def objects_by_mask(name: str, out: Path) -> Iterator[Found]:
    """Yield the objects of a set with hand-made masks."""
    project = reconstructed(name, out)
    context = load_context(project, BETTER, load_default_detector, load_default_sam)
    for truth in true_masks(name, list(context.views.cameras.by_photo)):
        evidence = next(iter(truth.files))
        (found, *_) = find_objects(context, MaskPrompt(evidence, truth.files[evidence]))
        yield Found(name, truth.name, context.views, DetailPhotos.of(project), found.members)


def stored_objects(folder: Path) -> Iterator[Found]:
    """Yield the objects of a project."""
    project = ProjectFolder.open_existing(folder)
    views = load_context(project, BETTER, load_default_detector, load_default_sam).views
    for record in list_objects(folder):
        members = load_membership(folder, record.id) >= record.threshold
        yield Found(folder.resolve().parent.name, record.name, views, DetailPhotos.of(project), members)


def measured(thing: Found, picture: Path | None = None) -> Figures | None:
    """Train detail and return the figures, None where no test photo shows the object.

    `picture` gets the object in the scene, with detail, and in its photo.
    """
    views = list(_views(thing))
    if not views:
        return None
    started = time.process_time()
    with PeakMemory.of() as peak:
        result = detail_object(thing.views, thing.photos, thing.members, BETTER, should_stop=never_stop)
    seconds = time.process_time() - started
    sys.stderr.write(f"{thing.photos.folder}, {thing.name}: {result.sentence}\n")
    trained = thing.trained()
    detailed = trained if result.detailed is None else result.detailed.gaussians
    rows, pictures = [], []
    for frame, photo, where, gain in views:
        shown = [np.clip(rendered(Scene(one), frame)[2] * gain, 0, 1) for one in (trained, detailed)]
        energy = gradient_energy(photo, where)
        errors = [-10 * np.log10(float(((one[where] - photo[where]) ** 2).mean())) for one in shown]
        rows.append([*errors, *(100 * gradient_energy(one, where) / energy for one in shown)])
        pictures.append((int(where.sum()), [*shown, photo], where))
    if picture is not None:
        _save(picture, *max(pictures, key=lambda one: one[0])[1:])
    before, after, soft, sharp = np.mean(rows, axis=0)
    return Figures(
        f"{thing.photo_set} | {thing.name}", photo.shape[1::-1], len(rows), (before, after), (soft, sharp),
        (share_of_needles(trained), share_of_needles(detailed)), (len(trained), len(detailed)),
        result.record.get("scale", float("nan")), seconds, (peak.bytes or float("nan")) / 1e9,
    )  # fmt: skip


def _views(thing: Found) -> Iterator[tuple[PinholeCamera, np.ndarray, Mask, np.ndarray]]:
    """Yield frame, pixels, compared pixels and brightness of each test photo that shows the object."""
    for camera in thing.views.cameras.cameras:
        if camera.photo in thing.photos.held_out:
            frame, photo = photo_at_own_size(camera, thing.photos)
            where = erode_mask(thing.views.scene.share(frame, thing.members) > _MIN_SHARE, EDGE_WIDTH)
            if where.sum() >= _MIN_PIXELS:
                yield frame, photo, where, thing.photos.gain(camera.photo)


def table(rows: Sequence[Figures]) -> str:
    """Return the Markdown table, with the means, and a sentence on which objects gain and lose."""
    lines = [
        "| set | object | pixels | photos | PSNR dB | detail | change | sharp | detail | needles | detail | Gaussians "
        "| detail | scale | CPU s | memory GB |",
        "| --- | --- |" + " ---: |" * 14,
    ]
    for row in rows:
        lines.append(
            f"| {row.name} | {row.size[0]} x {row.size[1]} | {row.n_photos} | {row.psnr[0]:.1f} | {row.psnr[1]:.1f} | "
            f"{row.change:+.1f} | {row.sharp[0]:.0f} | {row.sharp[1]:.0f} | {row.needles[0]:.0f} | "
            f"{row.needles[1]:.0f} | {row.n_gaussians[0]:,} | {row.n_gaussians[1]:,} | {row.scale:.2f} | "
            f"{row.cpu_seconds:.0f} | {row.memory:.1f} |"
        )
    (before, after), sharp, needles = (
        np.mean([getattr(row, name) for row in rows], axis=0) for name in ("psnr", "sharp", "needles")
    )
    lines.append(
        f"| **mean** | | | | {before:.1f} | {after:.1f} | {after - before:+.1f} | {sharp[0]:.0f} | {sharp[1]:.0f} | "
        f"{needles[0]:.0f} | {needles[1]:.0f} | | | | {np.mean([row.cpu_seconds for row in rows]):.0f} | "
        f"{np.mean([row.memory for row in rows]):.1f} |"
    )
    rises, falls = (sum(sign * row.change >= NOTICED for row in rows) for sign in (1, -1))
    return "\n".join([*lines, "", f"The PSNR rises for {rises} and falls for {falls} of {len(rows)} objects."])


def _save(file: Path, shown: Sequence[np.ndarray], where: Mask) -> None:
    rows, columns = (np.flatnonzero(where.any(axis=axis)) for axis in (1, 0))
    middle, half = (int(np.median(rows)), int(np.median(columns))), 260
    part = np.s_[max(0, middle[0] - half) : middle[0] + half, max(0, middle[1] - half) : middle[1] + half]
    Image.fromarray(np.hstack([(one[part] * 255).astype(np.uint8) for one in shown])).save(file, quality=88)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the objects and print the table, or write it into a document."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.own_size",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", type=Path, default=Path("out/real_sets"), help="(default: %(default)s)")
    parser.add_argument("--sets", default=",".join(SETS), help="(default: %(default)s)")
    parser.add_argument("--project", type=Path, action="append", default=[], help="measure its objects too")
    parser.add_argument("--picture", type=Path, help="JPEG of the last object: in the scene, with detail, its photo")
    parser.add_argument("--doc", type=Path, help="put the table between the marks of this document")
    parser.add_argument(
        "--work", type=Path, default=Path("out/own_size"),
        help="folder of what was measured; a stopped run continues there (default: %(default)s)",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    things = [thing for name in filter(None, options.sets.split(",")) for thing in objects_by_mask(name, options.out)]
    things += [thing for folder in options.project for thing in stored_objects(folder)]
    rows, unseen = [], []
    for thing in things:
        kept = options.work / f"{thing.photo_set}_{thing.name}.pickle"
        if not kept.exists():
            figures = measured(thing, options.picture if thing is things[-1] else None)
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(pickle.dumps(figures))
        figures = pickle.loads(kept.read_bytes())  # noqa: S301 written by this program
        if figures is None:
            unseen.append(f"{thing.name} of {thing.photo_set}")
        else:
            rows.append(figures)
    text = table(rows)
    if unseen:
        text += f"\n\nNo test photo shows {', '.join(unseen)}."
    print_table(text, options.doc, "own size")
    return 0


if __name__ == "__main__":
    sys.exit(main())
