"""Whether a click in a view hits the object that the eye sees there: ``python -m benchmarks.viewport_clicks PROJECT``.

Random pixels of random photos are clicked, as in a 3D view that looks through the photo's camera, and the object that
the ray of the click meets is compared with the true mask at the pixel. The scene is cut into objects by the true masks
(each Gaussian belongs to what most of its pixels show), so that only the click is measured; and, in a last row, by what
words have found.

example: python -m benchmarks.viewport_clicks out/museum_room/project --truth demo/museum_room/truth
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine.core.events import never_stop
from engine.pictures import Scene
from engine.project.objects import list_objects, load_membership
from engine.quality.evaluation import GroundTruth, read_ground_truth, write_section
from engine.quality.evaluation.gaussian_truth import gaussian_truth
from engine.scene import Camera, Gaussians, RayCaster, photo_ray, read_camera_set
from engine.training import load_gaussians

from .security.reader import addon

Labels = NDArray[np.int64]

_CLICKS, _SEEDS = 100, range(5)
"""Clicks of each row and seed."""


@dataclass(frozen=True)
class Clicks:
    """Clicks on what photos show, and how many of them hit it."""

    n: int
    hits: int


def objects_of_words(project: Path, truth: GroundTruth, count: int) -> Labels:
    """Return for each of `count` Gaussians the index in ``truth.objects`` of the project's object, -1 for none."""
    labels, best = np.full(count, -1), np.zeros(count, np.float32)
    for record in list_objects(project):
        if record.name in truth.objects:
            membership = load_membership(project, record.id)
            stronger = (membership >= record.threshold) & (membership > best)
            labels[stronger], best[stronger] = truth.objects.index(record.name), membership[stronger]
    return labels


def click_objects(
    gaussians: Gaussians,
    labels: Labels,
    cameras: Sequence[Camera],
    truth: GroundTruth,
    *,
    n: int,
    seed: int,
    beside: bool = False,
    among: Sequence[str] | None = None,
) -> Clicks:
    """Click `n` random pixels of the true masks, or with `beside` of what no mask shows.

    Parameters
    ----------
    gaussians : Gaussians
    labels : array of shape [N], int
        Index in ``truth.objects`` of the object of each Gaussian, -1 for none.
    cameras : sequence of Camera
    truth : GroundTruth
        With `every_pixel`.
    n, seed : int
    beside : bool
    among : sequence of str, optional
        Only these objects are clicked.
    """
    sight = addon("splats.sight")
    layer = sight.SplatLayer("scene", RayCaster(gaussians), np.eye(4), labels, np.arange(len(labels)))
    rng, hits, done = np.random.default_rng(seed), 0, 0
    usable = [camera for camera in cameras if camera.photo in truth.readers]
    while done < n:
        camera = usable[rng.integers(len(usable))]
        masks = truth.masks(camera.photo)
        wanted, mask = _target(masks, rng, beside=beside, among=among)
        if mask is None:
            continue
        rows, columns = np.nonzero(mask)
        if not len(rows):
            continue
        pick = rng.integers(len(rows))
        scale = camera.width / mask.shape[1]
        seen = sight.seen_on_ray([layer], *photo_ray(camera, (columns[pick] + 0.5) * scale, (rows[pick] + 0.5) * scale))
        hits += seen.label == (-1 if wanted is None else truth.objects.index(wanted))
        done += 1
    return Clicks(n, int(hits))


def _target(
    masks: dict[str, NDArray[np.bool_]], rng: np.random.Generator, *, beside: bool, among: Sequence[str] | None
) -> tuple[str | None, NDArray[np.bool_] | None]:
    """Return an object that a photo shows and its mask, or None and what no mask shows; (None, None) without one."""
    if beside:
        return (None, ~np.logical_or.reduce(list(masks.values()))) if masks else (None, None)
    names = [name for name in masks if among is None or name in among]
    if not names:
        return None, None
    name = names[rng.integers(len(names))]
    return name, masks[name]


def main() -> int:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("project", type=Path)
    parser.add_argument("--truth", type=Path, required=True, help="folder with the true masks")
    parser.add_argument("--doc", type=Path, help="file whose section is written")
    options = parser.parse_args()
    gaussians = load_gaussians(options.project / "gaussians")
    camera_set = read_camera_set(options.project / "cameras")
    truth = read_ground_truth(options.truth, [camera.photo for camera in camera_set.cameras])
    of_masks = gaussian_truth(Scene(gaussians), camera_set, truth, never_stop).astype(np.int64)
    of_masks[of_masks == len(truth.objects)] = -1
    of_words = objects_of_words(options.project, truth, len(gaussians))
    found = [truth.objects[index] for index in np.unique(of_words[of_words >= 0])]
    rows = {
        "objects of the true masks": (of_masks, False, None),
        "beside the objects": (of_masks, True, None),
        f"objects found by words ({len(found)})": (of_words, False, found),
    }
    lines = [f"| clicks on | hits of {_CLICKS}, by seed |", "| --- | --- |"]
    for name, (labels, beside, among) in rows.items():
        hits = [
            click_objects(
                gaussians, labels, camera_set.cameras, truth, n=_CLICKS, seed=seed, beside=beside, among=among
            ).hits
            for seed in _SEEDS
        ]
        lines.append(f"| {name} | {', '.join(map(str, hits))} |")
    table = "\n".join(lines)
    print(table)
    if options.doc:
        command = f"python -m benchmarks.viewport_clicks {options.project} --truth {options.truth}"
        write_section(options.doc, title="museum room", body=f"```\n{command}\n```\n\n{table}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
