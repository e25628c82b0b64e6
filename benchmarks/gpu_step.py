"""Cost of whole training steps on a graphics card, a part of ``make bench-gpu``.

A step: activations, image, L1 + SSIM, gradients, Adam, random walk, limits; with features also L_CC on 16,384 pixels of
200 segments, the disagreement along rays and L_reg on 1,000 anchors. Wall time of steps queued one after the other,
with all that the processor does for them. As in training, samples are drawn and sorted in a thread ahead of the queue.

example: python -m benchmarks.gpu_step 1000000
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.gpu import HEIGHT, WIDTH, camera, scene
from engine.core.files import write_json
from engine.rasterizer.gpu import open_adapter
from engine.training.densify import MAX_WALK
from engine.training.gpu import GpuParameters, GpuTrainer, PositionNoise, StepLimits, StepPlan, StepSettings
from engine.training.losses import (
    N_FAR,
    N_NEIGHBOURS,
    ClusteringSample,
    LabelledPixels,
    NeighbourSample,
    drawn_anchors,
    drawn_pixels,
    labelled_pixels,
)
from engine.training.schedule import Schedule
from engine.training.settings import TrainingSettings

STEPS, ROUNDS = 64, 4
SETTINGS = TrainingSettings()
CASES = {
    "RGB": (0, False, 1),
    "RGB, SH 3": (3, False, 1),
    "RGB+16, L_CC and L_reg in each step": (0, True, 1),
    "RGB+16, SH 3, L_CC and L_reg in each step": (3, True, 1),
    "RGB+16, SH 3, L_CC every 5th, L_reg every 10th step": (3, True, 5),
}
"""Name of each case: degree of spherical harmonics, whether features are trained, and every how many steps."""


def trainer_of(n: int, degree: int, has_features: bool) -> GpuTrainer:
    """Return a trainer with `n` Gaussians and a photo."""
    arrays = scene(n)
    values = {name: arrays[name].astype(np.float32) for name in ("means", "quats")}
    values["log_scales"] = np.log(arrays["scales"]).astype(np.float32)
    values["opacity_logits"] = np.log(arrays["opacities"] / (1.0 - arrays["opacities"])).astype(np.float32)
    values["sh_dc"] = np.ascontiguousarray(arrays["sh"][:, :1], np.float32)
    if degree:
        values["sh_rest"] = np.ascontiguousarray(arrays["sh"][:, 1:], np.float32)
    if has_features:
        values["features"] = np.ascontiguousarray(arrays["channels"][:, 3:], np.float32)
    limits = StepLimits((0.0, 0.0, 4.5), 100.0, 1e-5, 2.0, 50.0, 13.8)
    settings = StepSettings(lambda_scale=0.002, limits=limits, unit_features=True)
    gpu = open_adapter()
    trainer = GpuTrainer(gpu, GpuParameters(gpu, values), settings)
    trainer.add_photo(camera(), np.random.default_rng(2).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8))
    return trainer


def segments() -> LabelledPixels:
    """Return 200 segments, 20 columns of 10."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    found = labelled_pixels((1 + x * 20 // WIDTH + 20 * (y * 10 // HEIGHT)).astype(np.int32), min_pixels=100)
    assert found is not None
    return found


def measure(n: int, case: str) -> dict[str, float]:
    """Return milliseconds: a step, and what growth and the search of neighbours take."""
    degree, has_features, interval = CASES[case]
    trainer, labelled = trainer_of(n, degree, has_features), segments()
    schedule = Schedule(SETTINGS, 1, 1.0)
    neighbours = trainer.nearest_neighbours(N_NEIGHBOURS) if has_features else None

    def plan(step: int) -> StepPlan:
        rates: dict[str, float] = {name: 1e-5 * rate for name, rate in schedule.learning_rates(0).items()}
        clustering = regulariser = None
        if neighbours is not None and step % interval == 0:
            generator = torch.Generator().manual_seed(step)
            index, cluster, weight = drawn_pixels(labelled, SETTINGS.features.clustering_pixels, generator)
            clustering = ClusteringSample(index, cluster, labelled.counts.numpy(), 1e-6 * weight)
            if step % (2 * interval) == 0 or interval == 1:
                anchors, tries = drawn_anchors(n, generator)
                regulariser = NeighbourSample(anchors.numpy(), neighbours[anchors].numpy(), tries.numpy(), N_FAR, 1.0)
        if clustering is None:
            rates.pop("features", None)
        made = StepPlan(
            0, rates, degree, lambda_opacity=0.01, lambda_ray=0.01 if clustering else 0.0,
            terms=[sample for sample in (clustering, regulariser) if sample],
            noise=PositionNoise(1e-6, MAX_WALK, 0, step),
        )  # fmt: skip
        made.sort()
        return made

    def milliseconds(compute: Callable[[], Any], repeats: int) -> float:
        compute()
        times = []
        for _ in range(repeats):
            start = time.perf_counter()
            compute()
            times.append(1e3 * (time.perf_counter() - start))
        return statistics.median(times)

    counter = iter(range(10**9))

    def steps() -> None:
        with ThreadPoolExecutor(1) as ahead:
            trainer.steps(ahead.map(plan, [next(counter) for _ in range(STEPS)]))

    result = {"step": milliseconds(steps, ROUNDS) / STEPS}
    result["errors of a photo"] = milliseconds(lambda: trainer.gaussian_errors([0], degree), 5)
    geometry = trainer.geometry()
    sources, fresh = torch.arange(n), torch.zeros(n, dtype=torch.bool)
    result["reading the geometry"] = milliseconds(trainer.geometry, 5)
    result["moving Gaussians"] = milliseconds(lambda: trainer.rearrange(geometry, sources, fresh), 5)
    if has_features:
        result["neighbours of all"] = milliseconds(lambda: trainer.nearest_neighbours(N_NEIGHBOURS), 5)
    buffers = {id(one): one.size for frame in trainer._frames.values() for one in frame.buffers.values()}
    buffers |= {id(one): one.size for one in trainer.parameters.buffers.values()}
    result["MB"] = sum(buffers.values()) / 1e6
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("n", type=int, nargs="?", default=1_000_000, help="number of Gaussians")
    parser.add_argument("--results", type=Path, default=Path("out/gpu"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    figures = {case: measure(options.n, case) for case in CASES}
    write_json(options.results / f"step_{options.n}.json", {"card": open_adapter().name, "cases": figures})
    for case, row in figures.items():
        print(case, {name: round(value, 2) for name, value in row.items()})


if __name__ == "__main__":
    main()
