"""Errors in views that no photo has, and needles, by preset: ``python -m benchmarks.training.unseen COMMAND``.

`prepare` writes the photos of kept choosing rooms (`benchmarks.rooms`), and views off the photos' path, which Blender
renders. `train` needs these files and what `benchmarks.training.card` needs. A training that was measured before is not
repeated. `document` puts the table into a document.

example: python -m benchmarks.training.unseen prepare --rooms 3,6,8
         python -m benchmarks.training.unseen train --runs preview,standard,best --seeds 0,1
         python -m benchmarks.training.unseen document --doc docs/training.md
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from engine.core.errors import HeritageError
from engine.core.files import read_json, write_json
from engine.scene import read_camera_set
from engine.training import load_views
from engine.training.settings import PRESETS

from ..documents import put_into
from ..rooms.keeping import KEPT_FOLDER, unpack_room
from .card import run_settings, trained
from .off_path import KINDS, needles, off_path_figures
from .photo_sets import ROOT
from .screening.views_file import read_views, write_views

_PART = "off the path"
_SCHEMA = {"room": str, "run": str, "seed": int, "psnr": float, "needles": float, "off_path": dict}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/unseen"), help="(default: %(default)s)")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    one = commands.add_parser("prepare", help="write the photos and the true views of rooms")
    one.add_argument("--rooms", default="3,6,8", help="numbers of kept rooms (default: %(default)s)")
    one.set_defaults(run=_prepare)
    one = commands.add_parser("train", help="train and measure")
    one.add_argument("--runs", default="preview,standard,best", help="as of `card train` (default: %(default)s)")
    one.add_argument("--seeds", default="0", help="(default: %(default)s)")
    one.add_argument("--backend", default="gpu", choices=("gpu", "cpu"))
    one.set_defaults(run=_train)
    one = commands.add_parser("document", help="put the table of all results into a document")
    one.add_argument("--doc", type=Path, required=True)
    one.set_defaults(run=lambda options: put_into(options.doc, _PART, table(options.out / "results")))
    options = parser.parse_args(arguments)
    try:
        options.run(options)
    except HeritageError as error:
        sys.exit(str(error))


def _prepare(options: argparse.Namespace) -> None:
    from .off_path_views import true_views  # Not on the machine with the card: it needs every package of the engine.

    (options.out / "true").mkdir(parents=True, exist_ok=True)
    for number in map(int, options.rooms.split(",")):
        name = f"room_{number}"
        with tempfile.TemporaryDirectory() as folder:
            room = Path(folder) / name
            unpack_room(ROOT / KEPT_FOLDER / f"{name}.tar.xz", room)
            camera_set = read_camera_set(room / "project" / "cameras")
            views = load_views(room / "photos", camera_set, {}, PRESETS["standard"])
            write_views(options.out / f"{name}.npz", camera_set, views)
            write_views(options.out / "true" / f"{name}.npz", camera_set, true_views(room, camera_set))


def _train(options: argparse.Namespace) -> None:
    results = options.out / "results"
    results.mkdir(exist_ok=True)
    for file in sorted(options.out.glob("*.npz")):
        cameras, views = read_views(file)
        _, true = read_views(options.out / "true" / file.name)
        photos = [view for view in views if not view.held_out]
        for run in options.runs.split(","):
            for seed in map(int, options.seeds.split(",")):
                out = results / f"{file.stem}-{run.replace(':', '_').replace('=', '_')}-{seed}.json"
                if out.exists():
                    continue
                result = trained(cameras, views, run_settings(run, seed, views, options.backend))
                off_path = off_path_figures(result.gaussians, true, photos, backend=options.backend)
                figures = {"psnr": float(result.figures["psnr"]), "needles": needles(result.gaussians)}
                named = {"room": file.stem, "run": run, "seed": seed}
                write_json(out, {**named, **figures, "off_path": asdict(off_path)})
                sys.stderr.write(f"{out.stem}: {figures} {off_path}\n")


def table(results: Path) -> str:
    """Return the table of all results: means over the rooms and seeds of each run."""
    found: dict[str, list[dict[str, object]]] = {}
    for file in sorted(results.glob("*.json")):
        result = read_json(file, _SCHEMA, advice="Delete it.")
        found.setdefault(result["run"], []).append({**result, **result["off_path"]})
    lines = [
        f"| run | rooms | seeds | test photos | {' | '.join(KINDS)} | mean off the path | needles % |",
        "| --- |" + " ---: |" * (5 + len(KINDS)),
    ]
    for run, rows in found.items():
        means = {name: statistics.mean(float(str(row[name])) for row in rows) for name in ("psnr", *KINDS, "needles")}
        kinds = [means[kind] for kind in KINDS]
        cells = [f"{value:.2f}" for value in (means["psnr"], *kinds, statistics.mean(kinds))]
        counts = [str(len({row[name] for row in rows})) for name in ("room", "seed")]
        lines.append(f"| {run} | {' | '.join(counts)} | {' | '.join(cells)} | {means['needles']:.0f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
