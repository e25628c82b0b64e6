"""Comparison of a training step with OpenSplat on the CPU, on the same COLMAP project, in one run.

It needs OpenSplat's program and neither builds nor downloads it. Both programs train only colours, from the sparse
points, at full image size, before Gaussians are added. The cost of a step is computed from the difference between a
longer and a shorter run.

example: python -m benchmarks.opensplat path/to/opensplat path/to/colmap_project
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from engine.cameras import read_cameras
from engine.core.events import ignore_events, never_stop
from engine.core.system import cpu_seconds
from engine.photos import read_photos
from engine.photos.settings import PhotoSettings
from engine.training import load_views, start_gaussians, train
from engine.training.settings import PRESETS

_SHORT, _LONG = 20, 60
"""Numbers of steps of the two runs. OpenSplat adds Gaussians after 500 steps."""


@dataclass(frozen=True)
class StepTimes:
    """Milliseconds of one training step, and the number of Gaussians that it trains."""

    cpu_ms: float
    wall_ms: float
    n_gaussians: int


def measure_opensplat(program: Path, project: Path, steps: int, folder: Path) -> tuple[float, float]:
    """Return CPU and wall seconds of OpenSplat for `steps` steps on `project` (with ``images`` and ``sparse/0``)."""
    cpu, wall = cpu_seconds(), time.perf_counter()
    command = [program, project, "-n", steps, "--cpu", "--num-downscales", 0, "--sh-degree", 1]
    process = subprocess.run(
        [str(part) for part in [*command, "-o", folder / "opensplat.ply"]], capture_output=True, text=True, check=False
    )
    if process.returncode:
        raise SystemExit(f"{program} ended with code {process.returncode}: {process.stderr.strip()[-500:]}")
    return cpu_seconds() - cpu, time.perf_counter() - wall


def measure_ours(project: Path, steps: int, folder: Path) -> tuple[float, float, int]:
    """Return CPU and wall seconds of our training for `steps` steps on `project`, and the number of Gaussians."""
    photos = read_photos(project / "images", PhotoSettings(), emit=ignore_events)
    cameras = read_cameras(project / "sparse" / "0", photos)
    n_points = len(cameras.points)
    settings = PRESETS["standard"].changed(
        steps=steps, max_gaussians=n_points, background_fraction=0.0, train_features=False, coarse_levels=0,
        max_side=max(max(photo.width, photo.height) for photo in photos.photos), grow_from=1.0, grow_until=1.0,
        curve_points=1, checkpoint_interval=steps,
    )  # fmt: skip
    views = load_views(photos.folder, cameras, {}, settings)
    start = start_gaussians(cameras, views, settings, emit=ignore_events)
    figures = train(start, views, settings, checkpoints=folder, emit=ignore_events, should_stop=never_stop).figures
    return figures["cpu_seconds"], figures["wall_seconds"], len(start)


def compare_steps(program: Path, project: Path) -> tuple[StepTimes, StepTimes]:
    """Return the times of a step of OpenSplat and of ours.

    Raises
    ------
    SystemExit
        When OpenSplat fails; the message contains the end of its output.
    """
    per_step = []
    n_gaussians = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in ("opensplat", "ours"):
            runs = []
            for steps in (1, _SHORT, _LONG):  # The first run loads compiled code and photos and does not count.
                run_folder = Path(folder) / f"{name}-{steps}"
                run_folder.mkdir()
                if name == "opensplat":
                    runs.append(measure_opensplat(program, project, steps, run_folder))
                else:
                    *times, n_gaussians = measure_ours(project, steps, run_folder)
                    runs.append((times[0], times[1]))
            per_step.append((1e3 * (np.array(runs[2]) - np.array(runs[1])) / (_LONG - _SHORT)).tolist())
    theirs, ours = (StepTimes(cpu_ms=cpu, wall_ms=wall, n_gaussians=n_gaussians) for cpu, wall in per_step)
    return theirs, ours


def main() -> None:
    """Measure both programs and print the ratio of their times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("opensplat", type=Path, help="path to OpenSplat's program")
    parser.add_argument("project", type=Path, help="folder with images/ and sparse/0/")
    arguments = parser.parse_args()
    for path in (arguments.opensplat, arguments.project / "images", arguments.project / "sparse" / "0"):
        if not path.exists():
            parser.error(f"{path} does not exist")
    theirs, ours = compare_steps(arguments.opensplat, arguments.project)
    sys.stdout.write(
        f"OpenSplat  {theirs.cpu_ms:9.1f} CPU ms  {theirs.wall_ms:9.1f} wall ms per step\n"
        f"ours       {ours.cpu_ms:9.1f} CPU ms  {ours.wall_ms:9.1f} wall ms per step, {ours.n_gaussians:,} Gaussians\n"
        f"ratio      {theirs.cpu_ms / ours.cpu_ms:9.1f} in CPU time  "
        f"{theirs.wall_ms / ours.wall_ms:9.1f} in wall time\n"
    )


if __name__ == "__main__":
    main()
