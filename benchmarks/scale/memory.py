"""Peak memory of the whole way with large photos whose cameras are given: ``python -m benchmarks.scale.memory``.

The photos are those of the building, enlarged; their true cameras and points of their true surfaces come with them, as
other programs export them. Memory is that of the engine's process with all that it starts, shared pages counted once
(PSS). What is measured of a stage is written when the stage ends.

example: python -m benchmarks.scale.memory --photos 1000 --device cpu --out out/memory
         python -m benchmarks.scale.memory --table out/memory/memory.json --doc docs/many_photos.md
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from engine.core.arrays import Float64
from engine.core.engine_process import engine_command, engine_environment, events_in
from engine.core.events import ErrorEvent, StageStarted
from engine.core.files import write_json
from engine.core.system import describe_machine, usable_cores
from engine.project.folder import ProjectFolder

from ..documents import print_table
from ..processes import process_tree
from .building import FOCAL, HEIGHT, WIDTH, Building

_SEED = 0
_LARGER = 25 / 3
"""4000 x 3000 pixels."""
_POINTS_PER_PHOTO = 40
_PHOTOS_PER_TASK = 12
_LOOK_SECONDS = 0.5
_FLIPPED = np.diag([1.0, -1.0, -1.0, 1.0])
"""From COLMAP's axes of a camera to those of ``transforms.json``."""


def make_photos(count: int, folder: Path) -> None:
    """Write photos and ``transforms.json`` with its points into `folder`, what is missing."""
    (folder / "photos").mkdir(parents=True, exist_ok=True)
    tasks = [list(range(start, min(count, start + _PHOTOS_PER_TASK))) for start in range(0, count, _PHOTOS_PER_TASK)]
    with ProcessPoolExecutor(len(usable_cores())) as pool:
        points = np.concatenate(list(pool.map(_make, tasks, [folder] * len(tasks))))
    rows = "".join(f"{x:.4f} {y:.4f} {z:.4f} {r:.0f} {g:.0f} {b:.0f}\n" for x, y, z, r, g, b in points)
    head = "".join(f"property {kind}\n" for kind in ("float x", "float y", "float z"))
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    (folder / "points.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{head}end_header\n{rows}", encoding="ascii"
    )
    frames = [
        {
            "file_path": f"photos/{_name(index)}",
            "transform_matrix": (np.linalg.inv(viewmat) @ _FLIPPED).tolist(),
        }
        for index, viewmat in enumerate(Building(_SEED).cameras(count))
    ]
    width, height = _size()
    lens = {"w": width, "h": height, "fl_x": FOCAL * _LARGER, "fl_y": FOCAL * _LARGER}
    middle = {"cx": width / 2, "cy": height / 2, "camera_model": "PINHOLE", "ply_file_path": "points.ply"}
    write_json(folder / "transforms.json", {**lens, **middle, "frames": frames})


def _size() -> tuple[int, int]:
    return round(WIDTH * _LARGER), round(HEIGHT * _LARGER)


def _name(index: int) -> str:
    return f"{index:04d}.jpg"


def _make(indices: list[int], folder: Path) -> Float64:
    """Write photos, and return points [N, 6] of what they show: position and colour."""
    building = Building(_SEED)
    cameras = building.cameras(indices[-1] + 1)
    found = []
    for index in indices:
        viewmat = cameras[index]
        picture, depth = building.seen(viewmat)
        file = folder / "photos" / _name(index)
        if not file.is_file():
            large = Image.fromarray(picture).resize(_size(), Image.Resampling.BICUBIC)
            large.save(file.with_suffix(".unfinished"), "JPEG", quality=88)
            file.with_suffix(".unfinished").replace(file)
        pixels = np.random.default_rng([_SEED, index]).integers((0, 0), (WIDTH, HEIGHT), (_POINTS_PER_PHOTO, 2))
        rays = np.concatenate(
            [(pixels + 0.5 - (WIDTH / 2, HEIGHT / 2)) / FOCAL, np.ones((_POINTS_PER_PHOTO, 1))], axis=1
        )
        places = depth[pixels[:, 1], pixels[:, 0], None] * rays @ viewmat[:3, :3] - viewmat[:3, :3].T @ viewmat[:3, 3]
        found.append(np.concatenate([places, picture[pixels[:, 1], pixels[:, 0]]], axis=1))
    return np.concatenate(found)


def measure(folder: Path, out: Path, *, preset: str, device: str, prompts: str) -> None:
    """Reconstruct the photos of `folder`, and keep in ``OUT/memory.json`` what each stage took."""
    command = engine_command(
        "reconstruct", folder / "photos", "--out", out / "project", "--cameras", folder / "transforms.json",
        "--preset", preset, "--device", device, "--prompts", prompts, "--events",
    )  # fmt: skip
    names = [file for file in (folder / "photos").iterdir() if file.suffix == ".jpg"]
    peaks: dict[str, int] = {}
    result: dict[str, Any] = {
        "machine": describe_machine().name, "n_photos": len(names), "size": _size(), "preset": preset,
        "device": device, "stages": {},
    }  # fmt: skip
    stage, ended = "start", threading.Event()

    def look(pid: int) -> None:
        while not ended.wait(_LOOK_SECONDS):
            peaks[stage] = max(peaks.get(stage, 0), sum(map(_memory, process_tree(pid))))

    def keep() -> None:
        # Of a finished stage, the record of the project has the CPU seconds.
        found = {"wall": time.perf_counter() - begin, "peak_bytes": peaks.get(stage, 0)}
        with contextlib.suppress(Exception):
            record = ProjectFolder.open_existing(out / "project").stage_record(stage) or {}
            found |= {"cpu": record["cpu_seconds"], "own_peak_bytes": record["peak_memory"]}
        result["stages"][stage] = found
        write_json(out / "memory.json", result)

    begin = time.perf_counter()
    environment = {**engine_environment(), "GAUSSIAN_HERITAGE_CALIBRATION": str(out / "calibration.json")}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        looking = threading.Thread(target=look, args=(process.pid,))
        looking.start()
        try:
            for event in events_in(process.stdout):
                if isinstance(event, ErrorEvent):
                    sys.stderr.write(f"{event.message}\n")
                if isinstance(event, StageStarted):
                    keep()
                    stage, begin = event.stage, time.perf_counter()
            process.wait()
        finally:
            ended.set()
            looking.join()
    keep()
    result["code"] = process.returncode
    write_json(out / "memory.json", result)


def _memory(pid: int) -> int:
    """Return the bytes of a process, with its part of shared pages; 0 when it has ended."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * 1024
    return 0


def table(result: dict[str, Any]) -> str:
    """Return the table of what was measured."""
    width, height = result["size"]
    lines = [
        "Made by `python -m benchmarks.scale.memory`: "
        f"{result['n_photos']:,} photos of {width} x {height} pixels of the building, true cameras given, preset "
        f"`{result['preset']}` on {'a card' if result['device'] == 'gpu' else 'the processor'}, a word. "
        f"{result['machine']}.",
        "",
        "| stage | wall s | CPU s | memory, GB |",
        "| --- | ---: | ---: | ---: |",
    ]
    for name, one in result["stages"].items():
        used = f"{one['cpu']:.0f}" if "cpu" in one else ""
        lines.append(f"| {name} | {one['wall']:.0f} | {used} | {one['peak_bytes'] / 1e9:.2f} |")
    largest = max(one["peak_bytes"] for one in result["stages"].values())
    ended = "" if result.get("code") == 0 else " The run did not reach its end."
    return "\n".join([*lines, "", f"Most: {largest / 1e9:.2f} GB.{ended}", ""])


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the photos, measure, and print the table or write it into a document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photos", type=int, default=1000, help="default: %(default)s")
    parser.add_argument("--preset", default="standard", help="default: %(default)s")
    parser.add_argument("--device", default="cpu", choices=("cpu", "gpu"), help="what trains")
    parser.add_argument("--prompts", default="cabinet", help="default: %(default)s")
    parser.add_argument("--out", type=Path, default=Path("out/memory"), help="folder (default: %(default)s)")
    parser.add_argument("--table", type=Path, help="memory.json of a run: measure nothing")
    parser.add_argument("--doc", type=Path, help="document whose part `memory` is replaced")
    options = parser.parse_args(arguments)
    if options.table is None:
        made = options.out / f"photos_{options.photos}"
        begin = time.perf_counter()
        make_photos(options.photos, made)
        sys.stderr.write(f"photos: {time.perf_counter() - begin:.0f} s\n")
        measure(made, options.out, preset=options.preset, device=options.device, prompts=options.prompts)
    file = options.table or options.out / "memory.json"
    text = table(json.loads(file.read_text(encoding="utf-8")))
    print_table(text, options.doc, "memory")
    return 0


if __name__ == "__main__":
    sys.exit(main())
