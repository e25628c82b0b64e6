"""Cost of the rasterizer, the loss and Adam on the CPU: ``python -m benchmarks.raster [--out FILE.md]``.

The same scenes in our ``cpu`` rasterizer (one and two threads; this processor's vectors, and AVX2 alone), in a textbook
Numba rasterizer and in the torch reference, all in one run. CPU time is the honest figure on a shared machine; the
least of the repeats is told. What the promised ratios are made of is measured in three rounds, minutes apart, and the
better counts: on a shared machine everything is slower for seconds at a time, which no repeats in a row even out. Each
row runs in a process of its own, since Numba fixes the processor at its start.

example: python -m benchmarks.raster --quick
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from engine.project_folder import atomic_write

_SMALL, _LARGE = (640, 480), (1600, 1200)
_NUMBA_AS_IT_COMES = {"NUMBA_OPT": "3", "NUMBA_LOOP_VECTORIZE": "1"}
_AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+f16c,+lzcnt,+popcnt"}


@dataclass(frozen=True)
class Case:
    """What one process measures: a scene, by one implementation.

    Attributes
    ----------
    what : {"cpu", "speed_up", "blend", "textbook", "reference", "accuracy", "step", "parts", "memory", "compile"}
    n : int
        Gaussians.
    width, height : int
    channels : int
    threads : int
    avx2 : bool
        Compile for AVX2, whatever the processor has.
    repeats : int
    """

    what: str
    n: int = 20_000
    width: int = 640
    height: int = 480
    channels: int = 3
    threads: int = 1
    avx2: bool = False
    repeats: int = 40


def cases(quick: bool) -> Iterator[Case]:
    """Yield everything that is measured; only the smallest scene when `quick`."""
    scenes = [(20_000, _SMALL)]
    if not quick:
        scenes += [(n, size) for n in (20_000, 100_000, 300_000) for size in (_SMALL, _LARGE)][1:]
    for n, (width, height) in scenes:
        small = n == 20_000 and width == 640
        repeats = 40 if small else 5
        for channels in (3, 16, 19):
            size = {"n": n, "width": width, "height": height, "channels": channels}
            for threads in (1, 2):
                yield Case("cpu", threads=threads, repeats=repeats, **size)
            yield Case("cpu", avx2=True, repeats=repeats, **size)
            yield Case("blend", repeats=repeats, **size)
            yield Case("textbook", repeats=10 if small else 1, **size)
            if small:
                yield Case("reference", repeats=1, **size)
    yield Case("speed_up", channels=19)
    yield Case("accuracy", channels=19, repeats=1)
    yield Case("step")
    yield Case("parts")
    yield Case("compile", repeats=1)
    yield Case("memory", n=300_000, width=1600, height=1200, channels=19, repeats=1)


_ROUNDS = 3


def in_rounds(quick: bool) -> Iterator[Case]:
    """Yield all `cases`, and those of the smallest scene, the reference left out, in two more rounds between and after.

    They share out the larger scenes, so that the rounds are minutes apart.
    """
    every = list(cases(quick))
    large = [case for case in every if (case.n, case.width) != (20_000, 640)]
    small = [case for case in every if case not in large]
    yield from small
    again = [case for case in small if case.what not in ("reference", "parts", "accuracy")]
    for number in range(1, _ROUNDS):
        share = len(large) // (_ROUNDS - 1)
        yield from large[(number - 1) * share : number * share if number < _ROUNDS - 1 else None]
        yield from again


def better(what: str, one: dict[str, float], other: dict[str, float]) -> dict[str, float]:
    """Return what counts of two rounds of a case: the lesser of each figure.

    Figures that are there to be divided by each other are kept together: those of the round that blended faster, or in
    which a second core was more nearly there to be had for bare arithmetic.
    """
    if what == "blend":
        return min(one, other, key=lambda figures: figures["cpu_ms"])
    if what == "speed_up":
        return max(one, other, key=lambda figures: figures["one_spin_ms"] / figures["two_spin_ms"])
    return {name: min(value, other[name]) for name, value in one.items()}


def measure(case: Case) -> dict[str, float]:
    """Measure `case` in a fresh process and return its figures."""
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", **(_AVX2 if case.avx2 else {})}
    if case.what == "textbook":
        environment |= _NUMBA_AS_IT_COMES
    command = [sys.executable, "-m", "benchmarks.raster_case", json.dumps(asdict(case))]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{case} failed:\n{done.stderr}")
    figures: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return figures


def table(results: list[tuple[Case, dict[str, float]]]) -> str:
    """Return everything measured as Markdown."""
    found = dict(results)
    lines = [
        "| Gaussians | picture | K | cpu, 1 thread | 2 threads: CPU | 2 threads: wall | AVX2 only | blending alone "
        "| textbook Numba | torch reference | arithmetic floor | pairs | pairs/s |",
        "| ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]

    def cell(case: Case, key: str = "cpu_ms") -> str:
        matches = [figures for other, figures in results if _same(other, case)]
        return f"{matches[0][key]:,.1f}" if matches else "-"

    def _same(a: Case, b: Case) -> bool:
        return {**asdict(a), "repeats": 0} == {**asdict(b), "repeats": 0}

    for case in found:
        if case.what != "cpu" or case.threads != 1 or case.avx2:
            continue
        size = {"n": case.n, "width": case.width, "height": case.height, "channels": case.channels}
        own = found[case]
        lines.append(
            f"| {case.n:,} | {case.width}x{case.height} | {case.channels} | **{own['cpu_ms']:,.1f}** "
            f"| {cell(Case('cpu', threads=2, **size))} | {cell(Case('cpu', threads=2, **size), 'wall_ms')} "
            f"| {cell(Case('cpu', avx2=True, **size))} | {cell(Case('blend', **size))} "
            f"| {cell(Case('textbook', **size))} "
            f"| {cell(Case('reference', **size))} | {cell(Case('blend', **size), 'floor_ms')} | {own['pairs']:,.0f} "
            f"| {own['pairs'] / own['cpu_ms'] / 1e3:,.1f} M |"
        )
    return "\n".join(lines)


def figures(results: list[tuple[Case, dict[str, float]]]) -> str:
    """Return the ratios that are promised, each with its goal."""
    found = {(c.what, c.n, c.width, c.channels, c.threads, c.avx2): f for c, f in results}

    def cpu(what: str = "cpu", k: int = 19, avx2: bool = False) -> float:
        return found[(what, 20_000, 640, k, 1, avx2)]["cpu_ms"]

    blend = found[("blend", 20_000, 640, 19, 1, False)]
    threads = next(f for c, f in results if c.what == "speed_up")
    step = next(f for c, f in results if c.what == "step")
    compiled = next(f for c, f in results if c.what == "compile")
    memory = next(f for c, f in results if c.what == "memory")
    accuracy = next(f for c, f in results if c.what == "accuracy")
    allowed = 1024 * 300_000 + 200 * 1600 * 1200
    gained, there = (threads[f"one_{what}_ms"] / threads[f"two_{what}_ms"] for what in ("wall", "spin"))
    rows = [
        ("RGB+16: textbook Numba over our blending", cpu("textbook") / cpu("blend"), ">= 15"),
        ("RGB+16: textbook Numba, without projection, over ours with it", cpu("textbook") / cpu(), "-"),
        ("RGB+16: our blending over the arithmetic floor", blend["cpu_ms"] / blend["floor_ms"], "<= 2.8"),
        ("RGB+16 over RGB", cpu() / cpu(k=3), "<= 2.3"),
        ("RGB+16: one thread over two, in turn, wall", gained, ">= 1.8 idle"),
        ("bare arithmetic: one thread over two, the same, 2 if idle", there, "-"),
        ("RGB+16: its gain by a second thread over that of bare arithmetic", gained / there, ">= 0.9, 1.8 of 2"),
        ("RGB+16: AVX2 over this processor's own", cpu(avx2=True) / cpu(), "<= 1.5"),
        ("whole RGB step over the RGB pass", step["cpu_ms"] / cpu(k=3), "<= 4"),
        ("RGB+16: relative error of a gradient, median over the Gaussians", accuracy["median"], "<= 1e-5"),
        ("RGB+16: relative error of a gradient, 99.9 % of the Gaussians below", accuracy["99.9 %"], "<= 1e-3"),
        ("memory over 1 KB a Gaussian + 200 B a pixel", memory["bytes"] / allowed, "<= 1"),
        ("compiling for the first time, in two processes, wall s", compiled["first_wall_s"], "<= 12 idle"),
        ("compiling for the first time, CPU s of both with the second's imports", compiled["first_cpu_s"], "-"),
        ("loading compiled code, CPU s", compiled["again_s"], "<= 1"),
    ]
    lines = ["| figure | measured | goal |", "| --- | ---: | --- |"]
    return "\n".join(lines + [f"| {name} | {_short(value)} | {goal} |" for name, value, goal in rows])


def _short(value: float) -> str:
    return f"{value:.2f}" if value >= 0.01 else f"{value:.1e}"


def growth(results: list[tuple[Case, dict[str, float]]]) -> str:
    """Return how the cost grows: exponents of power laws fitted to the rows of one thread, RGB+16."""
    rows = [(c, f) for c, f in results if c.what == "cpu" and c.threads == 1 and not c.avx2 and c.channels == 19]
    lines = []
    for width in sorted({c.width for c, _ in rows}):
        points = [(c.n, f["cpu_ms"]) for c, f in rows if c.width == width]
        if len(points) > 1:
            slope = np.polyfit(*np.log(np.array(points).T), 1)[0]
            lines.append(f"With Gaussians N, {width} pixels wide: CPU time grows as N^{slope:.2f}.")
    for n in sorted({c.n for c, _ in rows}):
        points = [(c.width * c.height, f["cpu_ms"]) for c, f in rows if c.n == n]
        if len(points) > 1:
            slope = np.polyfit(*np.log(np.array(points).T), 1)[0]
            lines.append(f"With pixels P, {n:,} Gaussians: CPU time grows as P^{slope:.2f}.")
    return "\n".join(f"* {line}" for line in lines)


def parts(results: list[tuple[Case, dict[str, float]]]) -> str:
    """Return the cost of a training step's parts."""
    step = next(f for c, f in results if c.what == "step")
    lines = ["| part of an RGB step, 20,000 Gaussians, 640x480 | CPU ms |", "| --- | ---: |"]
    for case, values in results:
        if case.what == "parts":
            lines += [f"| {name} | {value:.1f} |" for name, value in values.items()]
    return "\n".join([*lines, f"| whole step | {step['cpu_ms']:.1f} |"])


def main() -> None:
    """Measure, print and, if asked, write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="only 20,000 Gaussians at 640x480")
    parser.add_argument("--out", type=Path, help="Markdown file for the tables")
    arguments = parser.parse_args()
    found: dict[Case, dict[str, float]] = {}
    for case in in_rounds(arguments.quick):
        figures_now = measure(case)
        found[case] = better(case.what, found[case], figures_now) if case in found else figures_now
        print(case, figures_now, file=sys.stderr, flush=True)
    results = list(found.items())
    peak = max(f["peak_gflops"] for c, f in results if c.what == "blend")
    text = f"""# Speed of the rasterizer

Written by `make bench-raster`. Forward and backward pass with projection, CPU milliseconds, least of the repeats,
those of 20,000 Gaussians at 640x480 in three rounds; figures that are divided by each other here come from one round:
that which blended faster, or in which bare arithmetic gained most by a second thread.
Gaussians with radii of 2 to 15 pixels at three standard deviations, opacity the sigmoid of N(0, 1.5); K channels: 3 is
colour of harmonics of degree 1, 16 features, 19 both. The textbook rasterizer has no projection: "blending alone" is
ours without it, tile lists, forward and backward; the arithmetic floor is that of blending too. The reference's graph
of larger scenes does not fit in memory. Pairs are those of a tile and a Gaussian that meet. Errors of gradients are
those of the worst parameter against the reference in float64, for a random gradient of the picture.
Arithmetic floor: as many operations as the 4x4 blocks that change need, all of them FMAs, done in turn with the
blending; {peak:.0f} GFLOP/s on one core in this run. It knows no loads, stores and comparisons, which take as long on
a core that does twice the FMAs: before the kernels asked for memory ahead they took 2.8 times the floor where FMAs
reach 59 GFLOP/s, 4.4 times where 120, 9 times where 238. Machine: {platform.machine()}, {os.cpu_count()} virtual
cores, shared.

{table(results)}

{figures(results)}

{growth(results)}

{parts(results)}

`python -m benchmarks.opensplat` times OpenSplat on the same photos and cameras where its program is at hand.
"""
    print(text)
    if arguments.out:
        with atomic_write(arguments.out) as stream:
            stream.write(text.encode())


if __name__ == "__main__":
    main()
