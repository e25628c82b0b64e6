"""What each part of the method of objects is worth: ``python -m benchmarks.rooms.ablations``.

The rooms are those of ``demo/random_rooms/choosing``, trained once and kept, so that only the method of this working
tree differs. Every object is prompted by one true mask, or by a click in its middle, and compared in photos that
neither training nor isolating saw. The figures are *in sample*: constants of the method were chosen on these rooms.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from engine.project.folder import ProjectFolder
from engine.quality.evaluation import evaluate_project
from engine.quality.evaluation.settings import EvaluationSettings

from ..documents import print_table
from .draws import CHOOSING_ROOMS
from .keeping import unpack_kept


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the rooms and print the table, or write it into a document."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rooms.ablations", description=__doc__)
    parser.add_argument("--prompt-kind", choices=("mask", "click"), default="mask", help="(default: %(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the table into this file")
    options = parser.parse_args(arguments)
    settings = EvaluationSettings(
        presets=("paper", "better"), prompt_kind=options.prompt_kind, ablations=True, view_counts=(4, 8)
    )
    ious: dict[str, list[float]] = {}
    for room in CHOOSING_ROOMS:
        for method, iou in _measured(room.name, settings).items():
            ious.setdefault(method, []).append(iou)
        sys.stderr.write(f"{room.name}: {ious['better'][-1]:.1f}\n")
    print_table(_table(ious), options.doc, f"ablations by {options.prompt_kind}")
    return 0


def _measured(room: str, settings: EvaluationSettings) -> dict[str, float]:
    """Return the mean IoU of the objects of a room by method, in percent."""
    with tempfile.TemporaryDirectory() as folder:
        project = ProjectFolder.open_existing(unpack_kept(room, Path(folder) / room))
        rows = evaluate_project(project, Path(folder) / room / "truth", settings).rows
    methods = dict.fromkeys(row.method for row in rows)
    return {method: 100 * float(np.mean([row.iou for row in rows if row.method == method])) for method in methods}


def _table(ious: dict[str, list[float]]) -> str:
    """Return a Markdown table: mean and worst room, and what the method gains over each row."""
    names = [room.name for room in CHOOSING_ROOMS]
    lines = [
        f"| method | {' | '.join(names)} | mean | worst | less than the method |",
        f"| --- | {'---: | ' * (len(names) + 3)}".rstrip(),
    ]
    best = np.mean(ious["better"])
    for method, values in ious.items():
        cells = " | ".join(f"{value:.1f}" for value in (*values, np.mean(values), min(values)))
        lines.append(f"| {method} | {cells} | {best - np.mean(values):.1f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
