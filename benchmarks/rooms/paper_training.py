"""The published training to its end, and its objects: ``python -m benchmarks.rooms.paper_training``.

Each room is trained once more with the preset ``paper``, all 30,000 steps, from the same photos, cameras and masks. The
published method isolates the objects of that scene, and ours those of the scene of the preset ``standard``, by one true
mask each and by the word. The rooms are those of ``demo/random_rooms/choosing``, or ``museum_room`` as `make demo` has
reconstructed it; *in sample* for ours. A room that was measured before is not measured again.

example: python -m benchmarks.rooms.paper_training --device gpu --out out/paper_training
         python -m benchmarks.rooms.paper_training --device gpu --rooms museum_room --gaussians 300000
         python -m benchmarks.rooms.paper_training --doc docs/paper.md
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from engine.cameras.settings import CameraSettings
from engine.core.errors import HeritageError
from engine.core.events import ignore_events, never_stop
from engine.core.files import finite_or_null, read_json, write_json
from engine.core.system import describe_machine
from engine.masks import load_default_sam
from engine.objects.grounding import load_default_detector
from engine.pipeline.planning import PlanSettings, choose_sizes, plan_work, training_settings
from engine.project.folder import ProjectFolder
from engine.quality.bench.prepared import read_prepared, train_prepared
from engine.quality.evaluation import evaluate_project
from engine.quality.evaluation.results import Row, Word
from engine.quality.evaluation.settings import EvaluationSettings, PromptKind
from engine.rasterizer import choose_device

from ..documents import print_table
from ..places import ROOT
from .draws import CHOOSING_ROOMS
from .keeping import unpack_kept

_TRAINED_AS: dict[str, tuple[str, ...]] = {"paper": ("paper", "released"), "standard": ("paper", "better")}
"""Methods that are compared on the scene of each preset of training."""
_MUSEUM_ROOM = "museum_room"
_SCHEMA = {"room": str, "training": dict, "methods": dict}


def main(arguments: Sequence[str] | None = None) -> int:
    """Train and measure the rooms that have no result, then print the table or write it into a document."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.rooms.paper_training", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--rooms", default=",".join(room.name for room in CHOOSING_ROOMS))
    parser.add_argument(
        "--gaussians", type=int, default=100_000,
        help="largest number, in place of the preset's million: a room has 24 photos of 480 x 360 pixels "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--device", choices=("auto", "cpu", "gpu"), default="auto", help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "paper_training", help="(default: %(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the table into this file")
    options = parser.parse_args(arguments)
    results = []
    try:
        load_default_sam()
        load_default_detector()  # A missing model is told before the trainings.
        for room in options.rooms.split(","):
            results.append(_result(room, options.out / room, options.device, options.gaussians))
    except HeritageError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    print_table(_table(results), options.doc, "trained as published")
    return 0


def _result(room: str, folder: Path, device: str, n_gaussians: int) -> dict[str, Any]:
    file = folder / "result.json"
    if file.exists():
        return read_json(file, _SCHEMA, advice="Delete it.")
    kept, truth = _kept(room, folder)
    trained = folder / "paper"
    if not trained.exists():
        shutil.copytree(kept, trained)
    training = _train(kept, trained, device, n_gaussians)
    projects = {"paper": trained, "standard": kept}
    methods = {}
    for preset, names in _TRAINED_AS.items():
        for kind in ("mask", "text"):
            for method, figures in _evaluated(projects[preset], truth, names, kind).items():
                methods[f"{method}, trained as {preset}, by {kind}"] = figures
    result = {"room": room, "training": training, "methods": methods}
    write_json(file, finite_or_null(result))
    sys.stderr.write(f"{room}: measured\n")
    return result


def _kept(room: str, folder: Path) -> tuple[Path, Path]:
    """Return the project of a room as it was trained with the preset ``standard``, and its ground truth."""
    if room == _MUSEUM_ROOM:
        return ROOT / "out" / room / "project", ROOT / "demo" / room / "truth"
    if not (folder / "kept").exists():
        unpack_kept(room, folder / "kept")
    return folder / "kept" / "project", folder / "kept" / "truth"


def _train(kept: Path, trained: Path, device: str, n_gaussians: int) -> dict[str, Any]:
    """Train the project `trained` with the preset ``paper`` and return the figures."""
    prepared = read_prepared(kept, never_stop)
    settings = PlanSettings(preset="paper", device=device)
    chosen = choose_device(device)
    work = plan_work(
        prepared.photo_set, prepared.statistics, settings, cameras=CameraSettings(),
        poses_given=True, points_given=True,
        choice=choose_sizes(settings, prepared.photo_set, chosen, None, free=describe_machine().free_bytes),
    )  # fmt: skip
    training = training_settings(work).changed(max_gaussians=n_gaussians)
    project = train_prepared(prepared, trained, work, training, emit=ignore_events, should_stop=never_stop)
    record = project.stage_record("training") or {}
    names = ("steps", "n_gaussians", "psnr", "wall_seconds", "device")
    return {name: record["figures"].get(name) for name in names}


def _evaluated(project: Path, truth: Path, presets: Sequence[str], kind: PromptKind) -> dict[str, dict[str, float]]:
    settings = EvaluationSettings(presets=tuple(presets), prompt_kind=kind)
    evaluation = evaluate_project(ProjectFolder.open_existing(project), truth, settings)
    figures = {}
    for preset in presets:
        words = [word for word in evaluation.words if word.method == preset]
        rows = [row for row in evaluation.rows if row.method == preset]
        asked: Sequence[Row | Word] = [word for word in words if not word.absent] if kind == "text" else rows
        figures[preset] = {
            "iou": 100 * mean(one.iou for one in asked),
            "boundary_iou": 100 * mean(one.boundary_iou for one in asked),
            "found": 100 * mean(one.found for one in asked),
        }
        if absent := [word for word in words if word.absent]:
            figures[preset]["refused"] = 100 * mean(word.n_results == 0 for word in absent)
    return figures


def _table(results: Sequence[dict[str, Any]]) -> str:
    lines = [
        "| method | rooms | mIoU | mBIoU | found: IoU of 0.5 or more, % | absent words refused, % |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for method in results[0]["methods"]:
        runs = [result["methods"][method] for result in results]
        cells = [f"{mean(run[name] for run in runs):.1f}" for name in ("iou", "boundary_iou", "found")]
        cells.append(f"{mean(run['refused'] for run in runs):.1f}" if "refused" in runs[0] else "")
        lines.append(f"| {method} | {len(runs)} | {' | '.join(cells)} |")
    trainings = [result["training"] for result in results]
    psnr = [one["psnr"] for one in trainings if one["psnr"] is not None]
    lines += [
        "",
        f"Preset `paper`: {min(one['steps'] for one in trainings):,} steps, up to "
        f"{max(one['n_gaussians'] for one in trainings):,} Gaussians, {mean(psnr):.2f} dB on the test photos, "
        f"{mean(one['wall_seconds'] for one in trainings):.0f} s on {trainings[0]['device']}.",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
