"""The queue of a large batch, simulated from the forecasts: no work is done, only the times that the plan expects.

Scenes are drawn from a few sizes with a fixed seed. A stage takes its forecast wall seconds times a random factor from
the spread that the forecast states; a worker does one stage at a time, as the batch asks for.
"""

from __future__ import annotations

import heapq
import math
import random
import statistics
import time
from dataclasses import dataclass, replace
from pathlib import Path

from distributed import Client, LocalCluster

from engine.cameras.settings import CameraSettings
from engine.core.events import ignore_events
from engine.core.system import Machine
from engine.photos import inspect_photos, read_photos
from engine.photos.settings import PhotoSettings
from engine.pipeline.planning.calibration import REFERENCE, Calibration
from engine.pipeline.planning.decisions import PlanSettings, WorkPlan, plan_work, training_settings
from engine.pipeline.planning.forecast import StageForecast, forecast_work

_CORES = 8
"""Cores of a machine in the simulation."""
_PHOTOS = (20, 40, 80, 120)
_SHARES = (0.3, 0.4, 0.2, 0.1)
_START_SECONDS = 4.0
"""Starting the engine once for each stage: Python, its libraries, and the checks of what is done."""
_LOSS_HOURS = 100.0
"""Mean hours between two losses of one worker."""
_N_TRIED = 1000
"""Empty tasks by which the scheduling cost of a task is measured."""


@dataclass
class _Result:
    hours: float
    busy: float
    losses: int
    lost_hours: float
    events: int


def simulation_table(photos: Path) -> str:
    """Return the tables of cost and of the simulated batches."""
    forecasts = {n: _forecast(photos, n) for n in _PHOTOS}
    cost = _scheduling_seconds()
    lines = [
        f"Forecasts of the preset `standard` without objects, for machines with {_CORES} cores of the reference speed, "
        "from the photos of the museum room. Forecast, not measured.",
        "",
        "| photos | "
        + " | ".join(one.stage for one in forecasts[_PHOTOS[0]])
        + " | all, CPU s | all, wall s | largest memory |",
        "| ---: | " + " | ".join("---:" for _ in forecasts[_PHOTOS[0]]) + " | ---: | ---: | ---: |",
    ]
    for n, stages in forecasts.items():
        cpu = [f"{one.cpu_seconds:.0f}" for one in stages]
        total, wall = sum(one.cpu_seconds for one in stages), sum(one.seconds for one in stages)
        most = max(one.memory_high for one in stages) / 1e9
        lines.append(f"| {n} | {' | '.join(cpu)} | {total:.0f} | {wall:.0f} | {most:.1f} GB |")
    lines += [
        "",
        f"Simulated batches: scenes of {', '.join(map(str, _PHOTOS))} photos in the shares "
        f"{', '.join(f'{share:.0%}' for share in _SHARES)}; {_START_SECONDS:.0f} s to start each stage; one loss of a "
        f"worker every {_LOSS_HOURS:.0f} h of its work, after which the stage begins again (training continues from a "
        f"checkpoint in reality). Measured: {1000 * cost:.1f} ms of CPU time for scheduling a task, from {_N_TRIED:,} "
        "empty tasks with scheduler, client and worker in one process.",
        "",
        "| machines | folders | tasks | hours | busy | workers lost | work lost | scheduler and client, CPU s |",
        "| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for machines, folders in ((1, 100), (10, 1_000), (100, 1_000), (100, 10_000)):
        one = _simulate(forecasts, machines, folders)
        work = one.busy * machines * one.hours
        lines.append(
            f"| {machines} | {folders:,} | {one.events:,} | {one.hours:.1f} | {one.busy:.1%} | {one.losses} | "
            f"{one.lost_hours / work:.2%} | {one.events * cost:.0f} |"
        )
    return "\n".join([*lines, ""])


def _scheduling_seconds() -> float:
    """Return the CPU seconds of giving a task to a worker and taking its answer, that of the worker among them."""
    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, resources={"MEMORY": 1e9}
    ) as cluster, Client(cluster, set_as_default=False) as client:  # fmt: skip
        client.submit(int, resources={"MEMORY": 1e9}, pure=False).result()
        begin = time.process_time()
        tasks = [client.submit(int, resources={"MEMORY": 1e9}, pure=False) for _ in range(_N_TRIED)]
        client.gather(tasks)
        return (time.process_time() - begin) / _N_TRIED


def _forecast(photos: Path, n: int) -> tuple[StageForecast, ...]:
    """Return the forecast for `n` photos: the museum room's, planned as if there were so many."""
    photo_set = read_photos(photos, PhotoSettings(), masks=None, emit=ignore_events, should_stop=lambda: False)
    looks = inspect_photos(photo_set, should_stop=lambda: False)
    kept = [photo_set.photos[i % len(photo_set.photos)] for i in range(n)]
    several = replace(photo_set, photos=tuple(replace(one, name=f"{i}_{one.name}") for i, one in enumerate(kept)))
    seen = [replace(looks[i % len(looks)], name=several.photos[i].name) for i in range(n)]
    work: WorkPlan = plan_work(
        several, seen, PlanSettings(preset="standard", wants_objects=False), cameras=CameraSettings(),
        poses_given=False, points_given=False,
    )  # fmt: skip
    machine = Machine(_CORES, 32_000_000_000, "cpu", "simulated")
    calibration = Calibration(Path("none"), "simulated", REFERENCE)
    return forecast_work(work, training_settings(work), machine, calibration).stages


def _simulate(forecasts: dict[int, tuple[StageForecast, ...]], machines: int, folders: int) -> _Result:
    rng = random.Random(0)
    sizes = rng.choices(_PHOTOS, _SHARES, k=folders)
    # As in the batch: the next stage of an earlier folder goes first.
    ready = [(number, 0) for number in range(folders)]
    heapq.heapify(ready)
    running: list[tuple[float, int, int]] = []
    now, busy, losses, lost, events, free = 0.0, 0.0, 0, 0.0, 0, machines
    while ready or running:
        while ready and free:
            number, index = heapq.heappop(ready)
            stage = forecasts[sizes[number]][index]
            deviation = math.log(stage.high / stage.seconds) / statistics.NormalDist().inv_cdf(0.9)
            seconds = _START_SECONDS + stage.seconds * rng.lognormvariate(0.0, deviation)
            taken = seconds
            while (until_loss := rng.expovariate(1.0 / (3600 * _LOSS_HOURS))) < seconds:
                losses, lost, taken = losses + 1, lost + until_loss, taken + until_loss
            heapq.heappush(running, (now + taken, number, index))
            busy += taken
            events += 1
            free -= 1
        now, number, index = heapq.heappop(running)
        free += 1
        if index + 1 < len(forecasts[sizes[number]]):
            heapq.heappush(ready, (number, index + 1))
    return _Result(now / 3600, busy / (now * machines), losses, lost / 3600, events)
