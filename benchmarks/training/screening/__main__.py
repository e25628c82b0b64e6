"""Screen variants of the training on an NVIDIA GPU: ``python -m benchmarks.training.screening COMMAND``.

`prepare` writes the views of photo sets on any machine with the engine. `train` needs these files, a GPU, and a Python
with torch, gsplat 1.5, numba, scipy, OpenCV and flip-evaluator; it trains several variants at once, without features,
trials and early stop. A stopped run continues. `table` prints the means over seeds.

example: python -m benchmarks.training.screening prepare --sets banana16,room_3 --out out/views
         python -m benchmarks.training.screening train out/views --variants no-features,growth-by-opacity
         python -m benchmarks.training.screening table out/views/results
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from engine.errors import HeritageError, SettingsError
from engine.events import ignore_events, never_stop
from engine.files import read_json, write_json
from engine.training import background_gaussians, load_views, start_gaussians, train
from engine.training.settings import PRESETS

from ..photo_sets import GAUSSIANS_OF_ROOMS, NAMES, ROOMS, photo_set
from ..running import TrainingBench
from ..variants import VARIANTS
from .gsplat_raster import gsplat_in_training
from .views_file import read_views, write_views

_FIGURES = {"psnr": float, "ssim": float, "dark_share": float}
_TRAINED = {"train_features": False, "trial_fraction": 0.0, "steps": 3000}


@dataclass(frozen=True)
class Job:
    """One training: the file of its views, a variant and a seed, and where its figures go."""

    views: Path
    variant: str
    seed: int
    out: Path


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
    screen.add_argument("--variants", required=True, help=f"of {', '.join(VARIANTS)}")
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
    bench = TrainingBench(Path("out/training"), preset="standard", objects=False)
    options.out.mkdir(parents=True, exist_ok=True)
    for photos in [photo_set(name) for name in options.sets.split(",")]:
        cameras = bench.cameras(photos)
        views = load_views(photos.photos, cameras, {}, PRESETS["standard"].changed(train_features=False))
        write_views(options.out / f"{photos.name}.npz", cameras, views)
        sys.stderr.write(f"{photos.name}: {len(views)} views\n")


def _train(options: argparse.Namespace) -> None:
    names = options.variants.split(",")
    if unknown := [name for name in names if name not in VARIANTS]:
        raise SettingsError(f"There is no variant {unknown[0]!r}, only {', '.join(VARIANTS)}.")
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
    context = multiprocessing.get_context("spawn")
    cores = context.Queue()
    for core in sorted(os.sched_getaffinity(0)):
        cores.put(core)
    with context.Pool(options.processes, initializer=_use_one_core, initargs=(cores,)) as pool:
        for done, job in enumerate(pool.imap_unordered(_run, missing), 1):
            sys.stderr.write(f"{done} of {len(missing)}: {job.out.stem}\n")
    sys.stdout.write(overview(results) + "\n")


def _use_one_core(cores: multiprocessing.Queue[int]) -> None:
    """Keep this process on one core: the threads of several trainings would get in each other's way."""
    os.sched_setaffinity(0, {cores.get()})


def _run(job: Job) -> Job:
    cameras, views = read_views(job.views)
    settings = PRESETS["standard"].changed(seed=job.seed, **{**_TRAINED, **VARIANTS[job.variant].changes})
    if job.views.stem in ROOMS:
        settings = settings.changed(max_gaussians=GAUSSIANS_OF_ROOMS)
    start = start_gaussians(cameras, views, settings, emit=ignore_events)
    background = background_gaussians(cameras.points, views, settings)
    with gsplat_in_training(), tempfile.TemporaryDirectory() as folder:
        result = train(
            start, views, settings, checkpoints=Path(folder), emit=ignore_events, should_stop=never_stop,
            background=background,
        )  # fmt: skip
    write_json(job.out, {name: result.figures[name] for name in _FIGURES})
    return job


def overview(results: Path) -> str:
    """Return the table of mean PSNR on test photos: a row per variant, a column per set."""
    found: dict[tuple[str, str], list[float]] = {}
    for file in sorted(results.glob("*.json")):
        name, _, rest = file.stem.partition("-")
        variant = rest.rpartition("-")[0]
        found.setdefault((variant, name), []).append(read_json(file, _FIGURES, advice="Delete it.")["psnr"])
    sets = sorted({name for _, name in found})
    trained = {variant for variant, _ in found}
    variants = [name for name in VARIANTS if name in trained]
    lines = [f"| PSNR dB | {' | '.join(sets)} |", f"| --- |{' ---: |' * len(sets)}"]
    for variant in variants:
        cells = [f"{statistics.mean(found[variant, name]):.2f}" if (variant, name) in found else "" for name in sets]
        lines.append(f"| {variant} | {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
