"""Trainings on a GPU, several at once. Not in ``__main__``, which the processes that are started do not import."""

from __future__ import annotations

import importlib.util
import multiprocessing
import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from engine.core.errors import EnvironmentProblem
from engine.core.events import ignore_events, never_stop
from engine.core.files import write_json
from engine.scene import Gaussians
from engine.training import Coverage, Parameters, TrainingView, background_gaussians, start_gaussians, train
from engine.training.quality import measure_levels
from engine.training.settings import PRESETS, TrainingSettings
from engine.training.views import ViewPyramid

from ..photo_sets import ROOMS
from ..variants import VARIANTS
from .gsplat_raster import gsplat_in_training
from .gsplat_training import train_gsplat
from .views_file import read_views

FIGURES = {"psnr": float, "fitted_psnr": float, "ssim": float, "dark_share": float}
"""Figures of a training on test photos, and their types."""

GSPLAT = "gsplat"
"""Name of the variant that gsplat trains itself."""

_GAUSSIANS_OF_ROOMS = 15_000
"""Gaussians of a random room, which is small."""

_TRAINED = {"train_features": False, "trial_fraction": 0.0, "steps": 3000}


@dataclass(frozen=True)
class Job:
    """One training: the file of its views, a variant and a seed, and where its figures go."""

    views: Path
    variant: str
    seed: int
    out: Path


def run_jobs(jobs: Sequence[Job], processes: int) -> Iterator[Job]:
    """Run jobs in several processes, spread over all GPUs, and yield each when it is done.

    Raises
    ------
    EnvironmentProblem
        When there is no GPU or no gsplat.
    """
    context = multiprocessing.get_context("spawn")
    places = context.Queue()
    n_gpus = max(1, torch.cuda.device_count())
    for place, core in enumerate(sorted(os.sched_getaffinity(0))):
        places.put((core, place % n_gpus))
    with context.Pool(processes, initializer=_stay, initargs=(places,)) as pool:
        yield from pool.imap_unordered(_run, jobs)


def _stay(places: multiprocessing.Queue[tuple[int, int]]) -> None:
    """Keep this process on one core, as the threads of several trainings would get in each other's way, and one GPU."""
    core, gpu = places.get()
    os.sched_setaffinity(0, {core})
    os.environ["CUDA_VISIBLE_DEVICES"] = str(gpu)


def _run(job: Job) -> Job:
    if importlib.util.find_spec("gsplat") is None or not torch.cuda.is_available():
        raise EnvironmentProblem("Screening needs an NVIDIA GPU and gsplat 1.5. Run it where both are.")
    cameras, views = read_views(job.views)
    n_training = sum(not view.held_out for view in views)
    settings = PRESETS["standard"].for_photos(n_training).changed(seed=job.seed, **_TRAINED)
    if job.views.stem in ROOMS:
        settings = settings.changed(max_gaussians=_GAUSSIANS_OF_ROOMS)
    if job.variant == GSPLAT:
        gaussians = train_gsplat(
            cameras, views, steps=settings.schedule.steps, max_gaussians=settings.growth.max_gaussians, seed=job.seed
        )
    else:
        settings = settings.changed(**VARIANTS[job.variant].changes)
        start = start_gaussians(cameras, views, settings, emit=ignore_events)
        background = background_gaussians(cameras.points, views, settings)
        with gsplat_in_training(), tempfile.TemporaryDirectory() as folder:
            gaussians = train(
                start, views, settings, checkpoints=Path(folder), emit=ignore_events, should_stop=never_stop,
                background=background,
            ).gaussians  # fmt: skip
    write_json(job.out, measured_figures(gaussians, views, settings))
    return job


def measured_figures(
    gaussians: Gaussians, views: Sequence[TrainingView], settings: TrainingSettings
) -> dict[str, float]:
    """Return the figures of `FIGURES` on the held-out views, with our rasterizer."""
    values = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False).values
    coverage = Coverage(values, [view.pinhole for view in views if not view.held_out])
    pyramid = ViewPyramid([view for view in views if view.held_out], settings.features)
    levels = [pyramid.level(index, 0) for index in range(len(pyramid.views))]
    measured = measure_levels(values, levels, coverage, backend=settings.backend, sh_degree=gaussians.sh_degree)
    return {
        "psnr": measured.quality.psnr, "fitted_psnr": measured.fitted.psnr, "ssim": measured.quality.ssim,
        "dark_share": measured.dark_share,
    }  # fmt: skip
