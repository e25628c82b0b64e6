"""Writing and reading 1,000,000 Gaussians with harmonics of degree 3, beside plyfile, gsply and splat-transform."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from engine.formats import read_glb, read_ply, read_spz, transform_gaussians, write_glb, write_ply, write_spz, write_usd
from engine.formats.spherical_harmonics import sh_basis
from engine.scene import Gaussians

__all__ = ["COUNT", "bytes_of", "memory_rows", "random_gaussians", "rotation_error", "speed_rows"]

COUNT = 1_000_000
N_ROUNDS = 3
N_MEMORY = 2_000_000
"""Gaussians whose peak memory is measured. It is proportional to them beyond the chunks, of a few megabytes."""
N_PLYFILE = 100_000
"""Gaussians that plyfile reads row by row; its time is proportional to them."""
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


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Return the least CPU and wall seconds of some calls."""
    cpu, wall = [], []
    for _ in range(N_ROUNDS):
        begin = time.process_time(), time.monotonic()
        call()
        cpu.append(time.process_time() - begin[0])
        wall.append(time.monotonic() - begin[1])
    return min(cpu), min(wall)


def speed_rows(folder: Path) -> list[Row]:
    """Measure in `folder`, and return rows of what, measured, goal. Seconds are those of the processor."""
    import gsply

    gaussians = random_gaussians(COUNT)
    ply, glb, spz, usd = (folder / f"a.{suffix}" for suffix in ("ply", "glb", "spz", "usdc"))
    rows: list[Row] = []

    def add(what: str, goal: str, call: Callable[[], object]) -> float:
        cpu, wall = timed(call)
        rows.append((what, f"{cpu:.2f} s ({wall:.2f} s)", goal))
        return cpu

    add("PLY written, turned", "1.5 s", lambda: write_ply(ply, gaussians, up="-y"))
    plain = add("PLY written without a turn", "", lambda: write_ply(ply, gaussians))
    read = add("PLY read", "1.5 s", lambda: read_ply(ply))
    # As its users make them: from arrays of their own.
    others = gsply.GSData.from_arrays(
        gaussians.means, gaussians.log_scales, gaussians.quats, gaussians.opacity_logits, gaussians.sh[:, 0],
        gaussians.sh[:, 1:],
    )  # fmt: skip
    gsply_write = add("gsply writes PLY", "", lambda: gsply.plywrite(str(folder / "g.ply"), others))
    gsply_read = add("gsply reads PLY, as arrays", "", lambda: _arrays_of(gsply.plyread(str(ply))))
    plyfile_read, plyfile_write = _plyfile_seconds(folder, gaussians)
    rows.append(("plyfile reads PLY, as arrays; writes it", f"{plyfile_read:.2f} s, {plyfile_write:.2f} s", ""))
    rows.append(("speed beside gsply, reading and writing", f"{gsply_read / read:.1f}, {gsply_write / plain:.1f}", "1"))
    rows.append(
        ("speed beside plyfile, reading and writing", f"{plyfile_read / read:.1f}, {plyfile_write / plain:.1f}", "3")
    )
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


def _arrays_of(data: Any) -> list[Any]:
    """Return contiguous arrays of what gsply read, which are views of its table until they are used."""
    return [
        np.ascontiguousarray(getattr(data, name)) for name in ("means", "scales", "quats", "opacities", "sh0", "shN")
    ]


def _plyfile_seconds(folder: Path, gaussians: Gaussians) -> tuple[float, float]:
    """Return the CPU seconds in which plyfile turns a file into arrays and arrays into a file, from fewer Gaussians."""
    from plyfile import PlyData, PlyElement

    write_ply(folder / "p.ply", gaussians[slice(0, N_PLYFILE)])
    table = PlyData.read(str(folder / "p.ply"))["vertex"]
    names = [one.name for one in table.properties]
    columns = [np.array(table[name]) for name in names]

    def read() -> Any:
        vertex = PlyData.read(str(folder / "p.ply"))["vertex"]
        return np.stack([np.asarray(vertex[name]) for name in names], axis=1)

    def write() -> None:
        rows = np.empty(N_PLYFILE, [(name, "f4") for name in names])
        for name, column in zip(names, columns, strict=True):
            rows[name] = column
        PlyData([PlyElement.describe(rows, "vertex")]).write(str(folder / "q.ply"))

    factor = COUNT / N_PLYFILE
    return timed(read)[0] * factor, timed(write)[0] * factor


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
import json, sys
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
file = folder / f"memory.{kind}"
options = {"up": "-y"} if what == "write ply" else {}
kept = getattr(formats, f"{verb}_{kind}")(file, *((gaussians,) if verb == "write" else ()), **options)
print(json.dumps((peak() - before) / size))
"""


def memory_rows(folder: Path) -> list[Row]:
    """Return the peak memory of each writer and reader, in sizes of the Gaussians, which are counted once."""
    rows = []
    for what in ("write ply", "read ply", "write glb", "read glb", "write spz", "read spz"):
        command = [sys.executable, "-c", _MEMORY, what, str(folder), str(N_MEMORY)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        rows.append((f"peak memory: {what}, times the data", f"{json.loads(done.stdout):.2f}", "2.2"))
    return rows
