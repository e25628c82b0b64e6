"""Screen variants of the training on an NVIDIA GPU: ``python -m benchmarks.training.screening COMMAND``.

`prepare` writes the views of photo sets on any machine with the engine. `train` needs these files, a GPU, and a Python
with torch, gsplat 1.5, numba, scipy, OpenCV and flip-evaluator; it trains several variants at once, without features
and trials, and as the variant `gsplat` what gsplat itself makes of the same views. A stopped run continues. `table`
prints the means over seeds.

example: python -m benchmarks.training.screening prepare --sets banana16,room_3 --out out/views
         python -m benchmarks.training.screening train out/views --variants no-features,growth-by-opacity
         python -m benchmarks.training.screening table out/views/results
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

from engine.core.errors import HeritageError, SettingsError
from engine.core.files import read_json
from engine.training import load_views
from engine.training.settings import PRESETS

from ..photo_sets import NAMES, photo_set
from ..variants import VARIANTS
from .jobs import FIGURES, GSPLAT, Job, run_jobs
from .views_file import write_views

_NAMES = (*VARIANTS, GSPLAT)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    prepare = commands.add_parser("prepare", help="write the views of photo sets; their cameras are estimated once")
    prepare.add_argument("--sets", required=True, help=f"of {', '.join(NAMES)}")
    prepare.add_argument("--out", type=Path, default=Path("out/views"), help="(default: %(default)s)")
    prepare.set_defaults(run=_prepare)
    screen = commands.add_parser("train", help="train variants on the GPU")
    screen.add_argument("views", type=Path, help="folder written by `prepare`")
    screen.add_argument("--variants", required=True, help=f"of {', '.join(_NAMES)}")
    screen.add_argument("--seeds", default="0", metavar="N,N", help="(default: %(default)s)")
    screen.add_argument("--processes", type=int, default=len(os.sched_getaffinity(0)), help="(default: one per core)")
    screen.set_defaults(run=_train)
    table = commands.add_parser("table", help="print the means over seeds")
    table.add_argument("results", type=Path, help="folder `results` beside the views")
    table.set_defaults(run=lambda options: sys.stdout.write(overview(options.results) + "\n"))
    options = parser.parse_args(arguments)
    try:
        options.run(options)
    except HeritageError as error:
        sys.exit(str(error))


def _prepare(options: argparse.Namespace) -> None:
    from ..running import TrainingBench  # Not on the machine with the GPU: it needs every package of the engine.

    bench = TrainingBench(Path("out/training"))
    options.out.mkdir(parents=True, exist_ok=True)
    for photos in [photo_set(name) for name in options.sets.split(",")]:
        cameras = bench.cameras(photos)
        views = load_views(photos.photos, cameras, {}, PRESETS["standard"].changed(train_features=False))
        write_views(options.out / f"{photos.name}.npz", cameras, views)
        sys.stderr.write(f"{photos.name}: {len(views)} views\n")


def _train(options: argparse.Namespace) -> None:
    names = options.variants.split(",")
    if unknown := [name for name in names if name not in _NAMES]:
        raise SettingsError(f"There is no variant {unknown[0]!r}, only {', '.join(_NAMES)}.")
    files = sorted(options.views.glob("*.npz"))
    if not files:
        raise SettingsError(f"{options.views} has no views. Write them with the command `prepare`.")
    results = options.views / "results"
    jobs = [
        Job(file, name, seed, results / f"{file.stem}-{name}-{seed}.json")
        for name in names
        for seed in map(int, options.seeds.split(","))
        for file in files
    ]
    missing = [job for job in jobs if not job.out.exists()]
    results.mkdir(exist_ok=True)
    for done, job in enumerate(run_jobs(missing, options.processes), 1):
        sys.stderr.write(f"{done} of {len(missing)}: {job.out.stem}\n")
    sys.stdout.write(overview(results) + "\n")


def overview(results: Path) -> str:
    """Return the table of mean PSNR and fitted PSNR on test photos: a row per variant, a column per set."""
    found: dict[tuple[str, str], list[dict[str, float]]] = {}
    for file in sorted(results.glob("*.json")):
        name, _, rest = file.stem.partition("-")
        variant = rest.rpartition("-")[0]
        found.setdefault((variant, name), []).append(read_json(file, FIGURES, advice="Delete it."))
    sets = sorted({name for _, name in found})
    trained = {variant for variant, _ in found}
    variants = [name for name in _NAMES if name in trained]
    lines = [f"| PSNR dB (fitted) | {' | '.join(sets)} |", f"| --- |{' ---: |' * len(sets)}"]
    for variant in variants:
        cells = [_cell(found.get((variant, name), ())) for name in sets]
        lines.append(f"| {variant} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(runs: Sequence[dict[str, float]]) -> str:
    if not runs:
        return ""
    psnr, fitted = (statistics.mean(run[figure] for run in runs) for figure in ("psnr", "fitted_psnr"))
    return f"{psnr:.2f} ({fitted:.2f})"


if __name__ == "__main__":
    main()
