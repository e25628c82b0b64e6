"""Writing and reading 1,000,000 Gaussians with harmonics of degree 3, beside plyfile, gsply and splat-transform."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from engine.formats import read_glb, read_ply, read_spz, transform_gaussians, write_glb, write_ply, write_spz, write_usd
from engine.formats.spherical_harmonics import sh_basis
from engine.scene import Gaussians

from .ply_programs import gsply_reads, gsply_writes, plyfile_reads, plyfile_writes, plyfile_writes_table

COUNT = 1_000_000
N_ROUNDS = 5
N_MEMORY = 2_000_000
"""Gaussians whose peak memory is measured. It is proportional to them beyond the chunks, of a few megabytes."""
N_MANY = 10_000_000
"""Gaussians of a large scene, written and read once."""
Row = tuple[str, str, str]


def random_gaussians(count: int) -> Gaussians:
    """Return Gaussians with random values of usual sizes, with harmonics of degree 3."""
    rng = np.random.default_rng(0)

    def normal(*shape: int) -> Any:
        return rng.standard_normal(shape, dtype=np.float32)

    sh = 0.15 * normal(count, 16, 3)
    return Gaussians(normal(count, 3), normal(count, 3) - 5, normal(count, 4), normal(count), sh)


def bytes_of(gaussians: Gaussians) -> int:
    """Return the memory of the arrays."""
    parts = (gaussians.means, gaussians.log_scales, gaussians.quats, gaussians.opacity_logits, gaussians.sh)
    return sum(part.nbytes for part in parts)


def timed(calls: Mapping[str, Callable[[], object]]) -> dict[str, tuple[float, float]]:
    """Return the least CPU and wall seconds of each of some calls, which are made in turn."""
    cpu, wall = ({name: float("inf") for name in calls} for _ in range(2))
    for _ in range(N_ROUNDS):
        for name, call in calls.items():
            begin = time.process_time(), time.monotonic()
            call()
            cpu[name] = min(cpu[name], time.process_time() - begin[0])
            wall[name] = min(wall[name], time.monotonic() - begin[1])
    return {name: (cpu[name], wall[name]) for name in calls}


def speed_rows(folder: Path) -> list[Row]:
    """Measure in `folder`, and return rows of what, measured, goal. Seconds are those of the processor."""
    gaussians = random_gaussians(COUNT)
    ply, glb, spz, usd = (folder / f"a.{suffix}" for suffix in ("ply", "glb", "spz", "usdc"))
    rows: list[Row] = []

    def add(what: str, goal: str, call: Callable[[], object]) -> None:
        rows.append((what, _seconds(timed({what: call})[what]), goal))

    rows += _ply_rows(folder, gaussians)
    add("GLB written", "2 s", lambda: write_glb(glb, gaussians))
    add("GLB read", "", lambda: read_glb(glb))
    add("SPZ written", "10 s", lambda: write_spz(spz, gaussians))
    add("SPZ read", "", lambda: read_spz(spz))
    add("USD written", "", lambda: write_usd(usd, gaussians))
    theirs = _splat_transform(ply, folder / "b.spz")
    ratio = spz.stat().st_size / theirs - 1
    rows.append(("size of SPZ beside splat-transform's (version 3)", f"{100 * ratio:+.1f} %", "+-5 %"))
    sizes = ", ".join(f"{one.suffix[1:].upper()} {one.stat().st_size / 1e6:.0f} MB" for one in (ply, glb, usd, spz))
    rows.append(("sizes", sizes, ""))
    rows.append(("rotation of harmonics: largest relative error", f"{rotation_error():.1e}", "1e-5"))
    return rows


def _ply_rows(folder: Path, gaussians: Gaussians) -> list[Row]:
    """Measure PLY beside other programs: all begin and end with the same arrays."""
    ply, of_gsply, of_plyfile = (folder / f"{name}.ply" for name in "agp")
    seconds = timed(
        {
            "PLY written, turned": lambda: write_ply(ply, gaussians, up="-y"),
            "PLY written without a turn": lambda: write_ply(ply, gaussians),
            "gsply writes PLY": lambda: gsply_writes(of_gsply, gaussians),
            "plyfile writes PLY, column by column": lambda: plyfile_writes(of_plyfile, gaussians),
            "plyfile writes PLY, a table made by NumPy": lambda: plyfile_writes_table(of_plyfile, gaussians),
            "PLY read": lambda: read_ply(ply),
            "gsply reads PLY": lambda: gsply_reads(ply),
            "plyfile reads PLY": lambda: plyfile_reads(ply),
        }
    )
    goals = {"PLY written, turned": "1.5 s", "PLY read": "1.5 s"}
    rows = [(what, _seconds(measured), goals.get(what, "")) for what, measured in seconds.items()]
    (write, read), beside = (seconds[f"PLY {what}"][0] for what in ("written without a turn", "read")), "speed beside"
    for name, how, goal in (
        ("gsply", "", "1"),
        ("plyfile", ", column by column", "3"),
        ("plyfile", ", a table made by NumPy", ""),
    ):
        ratio = seconds[f"{name} writes PLY{how}"][0] / write
        rows.append((f"{beside} {name}, writing{how}", f"{ratio:.1f}", goal))
    for name, goal in (("gsply", "1"), ("plyfile", "3")):
        rows.append((f"{beside} {name}, reading", f"{seconds[f'{name} reads PLY'][0] / read:.1f}", goal))
    return rows


def _seconds(measured: tuple[float, float]) -> str:
    return f"{measured[0]:.2f} s ({measured[1]:.2f} s)"


def _splat_transform(source: Path, target: Path) -> int:
    from .readers import splat_transform

    splat_transform("--spz-version", "3", source, target)
    return target.stat().st_size


def rotation_error() -> float:
    """Return the largest error of a turned colour relative to its change over directions, for random rotations."""
    rng = np.random.default_rng(1)
    gaussians = random_gaussians(200)
    directions = rng.standard_normal((100, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    worst = 0.0
    for _ in range(20):
        rotation = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        rotation *= np.linalg.det(rotation)
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        turned = transform_gaussians(gaussians, matrix)
        before = np.einsum("dk,nkc->ndc", sh_basis(directions, 3), gaussians.sh.astype(np.float64))
        after = np.einsum("dk,nkc->ndc", sh_basis(directions @ rotation.T, 3), turned.sh.astype(np.float64))
        worst = max(worst, float(np.abs(after - before).max() / np.abs(before).max()))
    return worst


_MEMORY = """
import json, sys, time
from pathlib import Path
import numpy as np
import engine.formats as formats
from benchmarks.formats.speed import bytes_of, random_gaussians
what, folder, count = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
def peak():
    return int(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]) * 1024
def now():
    return int(next(line for line in open("/proc/self/status") if line.startswith("VmRSS")).split()[1]) * 1024
verb, kind = what.split()
gaussians = random_gaussians(count if verb == "write" else 1)
size = bytes_of(gaussians) * (1 if verb == "write" else count)
before = now() - (bytes_of(gaussians) if verb == "write" else 0)
open("/proc/self/clear_refs", "w").write("5")
begin = time.process_time(), time.monotonic()
file = folder / f"memory.{kind}"
options = {"up": "-y"} if what == "write ply" else {}
kept = getattr(formats, f"{verb}_{kind}")(file, *((gaussians,) if verb == "write" else ()), **options)
seconds = time.process_time() - begin[0], time.monotonic() - begin[1]
print(json.dumps({"times": (peak() - before) / size, "bytes": peak() - before, "seconds": seconds}))
"""


def memory_rows(folder: Path) -> list[Row]:
    """Return the peak memory of each writer and reader, in sizes of the Gaussians, which are counted once.

    Of a large scene, also the time of one call.
    """
    rows = []
    for what in ("write ply", "read ply", "write glb", "read glb", "write spz", "read spz"):
        measured = _in_own_process(what, folder, N_MEMORY)
        rows.append((f"peak memory: {what}, times the data", f"{measured['times']:.2f}", "2.2"))
    for what in ("write ply", "read ply", "write glb", "read glb"):
        measured = _in_own_process(what, folder, N_MANY)
        text = (
            f"{_seconds(measured['seconds'])}, {measured['bytes'] / 1e9:.1f} GB, {measured['times']:.2f} times the data"
        )
        rows.append((f"{N_MANY:,} Gaussians: {what}", text, "2.2 times"))
    return rows


def _in_own_process(what: str, folder: Path, count: int) -> dict[str, Any]:
    """Return the peak memory, relative to the Gaussians and in bytes, and the CPU and wall seconds, of one call."""
    command = [sys.executable, "-c", _MEMORY, what, str(folder), str(count)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    measured: dict[str, Any] = json.loads(done.stdout)
    return measured
