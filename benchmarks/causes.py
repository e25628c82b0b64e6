"""Why objects by one true mask are not whole: ``python -m benchmarks.causes --doc docs/objects.md``.

In the kept choosing rooms the true object of every Gaussian is known. Where even this best assignment of Gaussians is
not whole, the scene is the cause: Gaussians straddle the outline, or the wall behind shines through. In the real sets
(`benchmarks.real_sets`, reconstructed below OUT) only masks are known.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from engine.core.events import never_stop
from engine.pictures import Scene
from engine.project.folder import ProjectFolder
from engine.quality.evaluation import evaluate_project, read_ground_truth
from engine.quality.evaluation.comparison import compare_with_all
from engine.quality.evaluation.gaussian_truth import gaussian_truth
from engine.quality.evaluation.results import WHOLE_IOU
from engine.quality.evaluation.settings import MARKS, EvaluationSettings
from engine.scene import read_camera_set
from engine.training import load_gaussians

from .documents import print_table
from .real_sets import SETS, measured
from .rooms.draws import CHOOSING_ROOMS
from .rooms.keeping import unpack_kept

_PART = "causes"
_ROOMS, _REAL = "choosing rooms", "real sets"
_CAUSES = {
    "scene": "the best assignment of Gaussians is not whole either",
    "holes": "parts of the object are missing",
    "halo": "more than the object is in it",
}


@dataclass(frozen=True)
class Outcome:
    """IoU of an object, 0 to 1, and the cause that counts if it is not whole: a name of `_CAUSES`."""

    data: str
    iou: float
    cause: str


def in_rooms() -> Iterator[Outcome]:
    """Yield the objects of the kept choosing rooms."""
    for room in CHOOSING_ROOMS:
        with tempfile.TemporaryDirectory() as folder:
            project = unpack_kept(room.name, Path(folder) / room.name)
            truth_folder = Path(folder) / room.name / "truth"
            by_mask = EvaluationSettings(presets=("better",), prompt_kind="mask")
            evaluation = evaluate_project(ProjectFolder.open_existing(project), truth_folder, by_mask)
            cameras = read_camera_set(project / "cameras")
            truth = read_ground_truth(truth_folder, list(cameras.by_photo))
            scene = Scene(load_gaussians(project / "gaussians"))
            labels = gaussian_truth(scene, cameras, truth, never_stop)
            members = [labels == number for number in range(len(truth.objects))]
            best = compare_with_all(
                scene, cameras.by_photo, members, truth, evaluation.photos, should_stop=never_stop
            ).iou.diagonal()
        for row in evaluation.rows:
            scene_is_whole = best[truth.objects.index(row.object)] >= WHOLE_IOU
            cause = "scene" if not scene_is_whole else "holes" if row.holes > row.halo + row.stray else "halo"
            yield Outcome(_ROOMS, row.iou, cause)


def in_real_sets(out: Path) -> Iterator[Outcome]:
    """Yield the objects of the real sets."""
    for name in SETS:
        for row in measured(name, out, ["better"]):
            yield Outcome(_REAL, row.iou / 100, "holes" if row.holes > row.halo + row.stray else "halo")


def table(objects: Sequence[Outcome]) -> str:
    """Return the Markdown table: objects, whole ones, and the causes of the others, by kind of data."""
    head = " | ".join(_CAUSES.values())
    lines = [f"| data | objects | whole | {head} |", f"| --- |{' ---: |' * (len(_CAUSES) + 2)}"]
    for data in (_ROOMS, _REAL):
        mine = [one for one in objects if one.data == data]
        missed = [one for one in mine if one.iou < WHOLE_IOU]
        counts = [sum(one.cause == cause for one in missed) for cause in _CAUSES]
        cells = [
            "not known" if data == _REAL and cause == "scene" else str(n)
            for cause, n in zip(_CAUSES, counts, strict=True)
        ]
        lines.append(f"| {data} | {len(mine)} | {len(mine) - len(missed)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure all objects and print the table, or write it into a document."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.causes", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/real_sets"), help="(default: %(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the table into this file")
    options = parser.parse_args(arguments)
    print_table(table([*in_rooms(), *in_real_sets(options.out)]), options.doc, _PART, MARKS["in sample"])
    return 0


if __name__ == "__main__":
    sys.exit(main())
