"""Quality of training on a graphics card against seconds: ``python -m benchmarks.training.card COMMAND``.

`prepare` writes photos, cameras and segments of sets on a machine with the whole engine; `prepare-rooms` those of kept
choosing rooms (`benchmarks.rooms`) without segments, and views off the photos' path, which Blender renders once;
`prepare-gallery` those of a generated walk. `train` needs these files, a graphics card, and a Python with torch, wgpu,
numba, scipy, OpenCV and flip-evaluator; with ``--backend gsplat``, gsplat 1.5, with fused-ssim, trains the same views
by its own rates and without features, with ``--backend cpu`` the processor, on all cores that the process may use. A
training that was measured before is not repeated. `document` puts a table into a document, between ``<!-- NAME -->``
and its end: means over seeds by set and run, those off the path, or errors and seconds, of which `plot` makes a
picture.

A run is STEPS:GAUSSIANS with settings of `standard`, or the name of a preset as the plan uses it on the device.

example: python -m benchmarks.training.card prepare --sets museum_room --sides 640 --out out/card
         python -m benchmarks.training.card train out/card --runs 3000:300000,7000:300000 --seeds 0,1,2
         python -m benchmarks.training.card train out/card --runs standard,best,best:lr_means=8e-4
         python -m benchmarks.training.card document out/card/results --doc FILE.md
         python -m benchmarks.training.card prepare-rooms --rooms 3,6,8 --out out/off_path
         python -m benchmarks.training.card train out/off_path --runs preview,standard,best --seeds 0,1
         python -m benchmarks.training.card document out/off_path/results --doc docs/training.md --table "off the path"
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch

from engine.core.errors import HeritageError, SettingsError
from engine.core.events import ignore_events, never_stop
from engine.core.files import atomic_write, read_json, write_json
from engine.core.system import usable_cores
from engine.pipeline.planning.decisions import steps_for
from engine.scene import CameraSet, read_camera_set
from engine.training import (
    TrainingView,
    background_gaussians,
    load_views,
    settings_with_sizes,
    sizes_on_card,
    start_gaussians,
    train,
)
from engine.training.settings import PRESETS, TrainingSettings

from ..documents import put_into
from ..rooms.keeping import unpack_kept
from .error_curves import ERROR_AND_SECONDS, SETS_AND_RUNS, error_plot, error_table, sets_table
from .gallery import gallery_views
from .gsplat_training import GSPLAT, measured_figures, train_gsplat
from .off_path import (
    OFF_PATH,
    OFF_PATH_ON_PROCESSOR,
    TrueView,
    needles,
    off_path_figures,
    off_path_table,
    read_true_views,
    write_true_views,
)
from .photo_sets import photo_set
from .views_file import read_views, write_views

_MAX_NAME = 160
_UNBOUNDED = 1 << 62
_TRUE = "true"
"""Folder of the true views off the path, beside the views of rooms."""
_TABLES = {
    OFF_PATH: off_path_table,
    OFF_PATH_ON_PROCESSOR: off_path_table,
    ERROR_AND_SECONDS: error_table,
    SETS_AND_RUNS: sets_table,
}
"""By the name that the table has in a document."""
_SCHEMA = {"set": str, "run": str, "seed": int, "first": float, "figures": dict}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    one = commands.add_parser("prepare", help="write the views of photo sets with their segments")
    one.add_argument("--sets", required=True)
    one.add_argument("--sides", default="640", help="longest sides of the photos, pixels (default: %(default)s)")
    one.add_argument("--out", type=Path, default=Path("out/card"), help="(default: %(default)s)")
    one.add_argument("--without-masks", action="store_true", help="for trainings without segmentation features")
    one.set_defaults(run=_prepare)
    one = commands.add_parser("prepare-rooms", help="write the views of kept rooms, and true views off the path")
    one.add_argument("--rooms", default="3,6,8", help="numbers of kept rooms (default: %(default)s)")
    one.add_argument("--out", type=Path, required=True)
    one.set_defaults(run=_prepare_rooms)
    one = commands.add_parser("prepare-gallery", help="write the views of a walk through four generated rooms")
    one.add_argument("--out", type=Path, default=Path("out/card"), help="(default: %(default)s)")
    one.set_defaults(run=_prepare_gallery)
    one = commands.add_parser("train", help="train and measure")
    one.add_argument("views", type=Path, help="folder written by `prepare` or `prepare-rooms`")
    one.add_argument("--runs", required=True, help="STEPS:GAUSSIANS or PRESET[:NAME=VALUE ...], with commas between")
    one.add_argument("--only", default="", help="files whose names begin like this")
    one.add_argument("--seeds", default="0", help="(default: %(default)s)")
    one.add_argument("--backend", default="gpu", choices=("gpu", "cpu", GSPLAT))
    one.add_argument("--jobs", type=int, default=1, help="trainings at a time, whose seconds then say nothing")
    one.set_defaults(run=_train)
    one = commands.add_parser("document", help="put a table of results into a document")
    one.add_argument("results", type=Path)
    one.add_argument("--doc", type=Path, required=True)
    one.add_argument("--table", default=SETS_AND_RUNS, choices=_TABLES, help="(default: %(default)s)")
    one.set_defaults(run=_document)
    one = commands.add_parser("plot", help="draw errors against seconds")
    one.add_argument("results", type=Path)
    one.add_argument("--out", type=Path, required=True, help="PNG file")
    one.set_defaults(run=_plot)
    options = parser.parse_args(arguments)
    try:
        options.run(options)
    except HeritageError as error:
        sys.exit(str(error))


def _prepare(options: argparse.Namespace) -> None:
    from .running import TrainingBench  # Not on the machine with the card: it needs every package of the engine.

    bench = TrainingBench(Path("out/training"))
    options.out.mkdir(parents=True, exist_ok=True)
    for photos in [photo_set(name) for name in options.sets.split(",")]:
        cameras, label_maps = bench.cameras(photos), {}
        if not options.without_masks:
            label_maps = bench.prepared(photos).label_maps
        for side in map(int, options.sides.split(",")):
            settings = PRESETS["standard"].changed(max_side=side)
            views = load_views(photos.photos, cameras, label_maps, settings)
            write_views(options.out / f"{photos.name}-{side}.npz", cameras, views)
            sys.stderr.write(f"{photos.name}, {side} pixels: {len(views)} views\n")


def _prepare_rooms(options: argparse.Namespace) -> None:
    from .off_path_views import true_views  # Not on the machine with the card: it needs every package of the engine.

    (options.out / _TRUE).mkdir(parents=True, exist_ok=True)
    for number in map(int, options.rooms.split(",")):
        name = f"room_{number}"
        true_file = options.out / _TRUE / f"{name}.npz"
        if true_file.exists():
            continue
        with tempfile.TemporaryDirectory() as folder:
            room = Path(folder) / name
            unpack_kept(name, room)
            cameras = read_camera_set(room / "project" / "cameras")
            views = load_views(room / "photos", cameras, {}, PRESETS["standard"])
            write_views(options.out / f"{name}.npz", cameras, views)
            trained = [view.pinhole for view in views if not view.held_out]
            write_true_views(true_file, cameras, true_views(room, cameras, trained))


def _prepare_gallery(options: argparse.Namespace) -> None:
    options.out.mkdir(parents=True, exist_ok=True)
    cameras, views = gallery_views(PRESETS["standard"].measurement.held_out_every)
    write_views(options.out / "gallery.npz", cameras, views)


def _train(options: argparse.Namespace) -> None:
    if options.jobs < 1:
        raise SettingsError(f"--jobs must be at least 1, got {options.jobs}.")
    results = options.views / "results"
    results.mkdir(exist_ok=True)
    jobs = [
        _Job(file, run, seed, options.backend, results)
        for file in sorted(options.views.glob(f"{options.only}*.npz"))
        for run in options.runs.split(",")
        for seed in map(int, options.seeds.split(","))
    ]
    missing = [job for job in jobs if not job.out.exists()]
    with multiprocessing.get_context("spawn").Pool(options.jobs) as pool:
        for line in pool.imap_unordered(_measure, missing):
            sys.stderr.write(line)


@dataclass(frozen=True)
class _Job:
    """One training: the file of its views, its run and seed, what trains it, and the folder for its figures."""

    file: Path
    run: str
    seed: int
    backend: str
    results: Path

    @property
    def name(self) -> str:
        """Name of the run in tables."""
        return f"{GSPLAT}:{self.run}" if self.backend == GSPLAT else run_name(self.run, self.backend)

    @property
    def out(self) -> Path:
        """File for the figures."""
        return self.results / f"{self.file.stem}-{_file_name(self.name)}-{self.seed}.json"


_first_seconds: list[float] = []
"""Time of the first steps of this process, once they are made."""


def _measure(job: _Job) -> str:
    """Train, write the figures, and return them as a line."""
    cameras, views = read_views(job.file)
    true_file = job.file.parent / _TRUE / job.file.name
    true = read_true_views(true_file) if true_file.exists() else []
    # What gsplat trains is measured on the processor.
    backend = "cpu" if job.backend == GSPLAT else job.backend
    run_with: Callable[..., dict[str, Any]] = _run_gsplat if job.backend == GSPLAT else partial(_run, true=true)
    settings = run_settings(job.run, job.seed, views, backend)
    if not _first_seconds:
        # The first run of a process compiles kernels: steps of the same kind do it before the clock runs.
        few = settings.changed(steps=12, sh_interval=4, regularisation_interval=5, coarse_levels=0)
        begun = time.perf_counter()
        run_with(cameras, views, few)
        _first_seconds.append(time.perf_counter() - begun)
    figures, first = run_with(cameras, views, settings), _first_seconds[0]
    content = {"set": job.file.stem, "run": job.name, "seed": job.seed, "first": first, "figures": figures}
    write_json(job.out, content)
    return (
        f"{job.out.stem}: {figures['psnr']:.2f} dB, fitted {figures['fitted_psnr']:.2f}, "
        f"{figures['wall_seconds']:.1f} s, {figures['n_gaussians']} Gaussians, first {first:.1f} s, "
        f"{figures['total']:.1f} s in all\n"
    )


def run_name(run: str, backend: str) -> str:
    """Return the name of a run with the cores that the processor has for it."""
    return f"{len(usable_cores())} cores:{run}" if backend == "cpu" else run


def _file_name(run: str) -> str:
    """Return a run as a part of a file name, which file systems limit to 255 bytes."""
    name = run.replace(":", "_").replace("=", "_").replace(" ", "_")
    return name if len(name) <= _MAX_NAME else f"{name[:_MAX_NAME]}-{hashlib.sha256(run.encode()).hexdigest()[:8]}"


def run_settings(run: str, seed: int, views: Sequence[TrainingView], backend: str) -> TrainingSettings:
    """Return the settings of a run that is named as the module's documentation says, for photos at their own size."""
    first, *others = run.split(":")
    n_training = sum(not view.held_out for view in views)
    if first in PRESETS:
        sizes = {} if backend == "cpu" else sizes_on_card(first, _UNBOUNDED, n_training=n_training)
        settings = settings_with_sizes(first, sizes, n_training)
        settings = settings.changed(**_values(others))
        settings = settings.with_steps(steps_for(settings, n_training))
    else:
        settings = PRESETS["standard"].for_photos(n_training).changed(steps=int(first), max_gaussians=int(others[0]))
        settings = settings.changed(**_values(others[1:]))
    return settings.changed(seed=seed, backend=backend, max_side=4096)


def _values(others: Sequence[str]) -> dict[str, Any]:
    return {name: _value(text) for name, text in (other.split("=") for other in others)}


def _value(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except ValueError:  # a word
        return text


def _run(
    cameras: CameraSet, views: Sequence[TrainingView], settings: TrainingSettings, *, true: Sequence[TrueView]
) -> dict[str, Any]:
    """Train the views of a set from its sparse points and measure, also in the `true` views where there are any."""
    begun = time.perf_counter()
    start = start_gaussians(cameras, views, settings, emit=ignore_events)
    background = background_gaussians(cameras.points, views, settings)
    with tempfile.TemporaryDirectory() as folder:
        result = train(
            start, list(views), settings, checkpoints=Path(folder), emit=ignore_events, should_stop=never_stop,
            background=background,
        )  # fmt: skip
    curve = [asdict(point) for point in result.curve]
    figures = {**result.figures, "curve": curve, "total": time.perf_counter() - begun}
    if true:
        off_path = off_path_figures(result.gaussians, true, backend=settings.backend)
        figures |= {"off_path": asdict(off_path), "needles": needles(result.gaussians)}
    return figures


def _run_gsplat(cameras: Any, views: Sequence[TrainingView], settings: TrainingSettings) -> dict[str, Any]:
    n = settings.growth.max_gaussians
    begun = time.perf_counter()
    gaussians = train_gsplat(cameras, views, steps=settings.schedule.steps, max_gaussians=n, seed=settings.seed)
    torch.cuda.synchronize()
    seconds = time.perf_counter() - begun
    figures: dict[str, Any] = dict(measured_figures(gaussians, views, settings))
    total = time.perf_counter() - begun
    return {**figures, "wall_seconds": seconds, "n_gaussians": len(gaussians), "curve": [], "total": total}


def _document(options: argparse.Namespace) -> None:
    results = [read_json(file, _SCHEMA, advice="Delete it.") for file in sorted(options.results.glob("*.json"))]
    put_into(options.doc, options.table, _TABLES[options.table](results))


def _plot(options: argparse.Namespace) -> None:
    results = [read_json(file, _SCHEMA, advice="Delete it.") for file in sorted(options.results.glob("*.json"))]
    with atomic_write(options.out) as out:
        out.write(error_plot(results))


if __name__ == "__main__":
    main()
