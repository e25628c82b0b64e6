"""Cost of the rasterizer, the loss and Adam on the CPU: ``python -m benchmarks.raster [--document FILE]``.

It renders the same scenes with our ``cpu`` rasterizer (one and two threads; all vector instructions of this processor,
and AVX2 only), with a scalar, unblocked rasterizer in Numba and with the torch reference, in one run. Goals refer to
the arithmetic floor and, where its program is given, to OpenSplat. The figures are CPU times, because wall times depend
on other programs on a shared machine, and the shortest of all repeats is reported. The times behind the ratios with a
goal are measured in three rounds, minutes apart, and the best round counts, because a shared machine can be slow for
seconds, which consecutive repeats do not even out. Each case runs in its own process, because Numba selects the
processor when it starts.

example: python -m benchmarks.raster --quick
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from .documents import print_table
from .opensplat import StepTimes, compare_steps

_SMALL, _LARGE = (640, 480), (1600, 1200)
_NUMBA_DEFAULTS = {"NUMBA_OPT": "3", "NUMBA_LOOP_VECTORIZE": "1"}
"""Environment that restores Numba's defaults, which `engine.rasterizer.jit` changes."""

_AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+f16c,+lzcnt,+popcnt"}


@dataclass(frozen=True)
class Case:
    """One measurement in one process.

    Attributes
    ----------
    what : {"cpu", "speed_up", "blend", "scalar", "reference", "accuracy", "step", "parts", "memory", "compile"}
    n : int
        Number of Gaussians.
    width, height : int
    channels : int
    threads : int
    avx2 : bool
        Compile for AVX2, even if the processor has more vector instructions.
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
    """Yield all cases, or only those of the smallest scene if `quick`."""
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
            yield Case("scalar", repeats=10 if small else 1, **size)
            if small:
                yield Case("reference", repeats=1, **size)
    yield Case("speed_up", channels=19)
    yield Case("accuracy", channels=19, repeats=1)
    yield Case("step")
    yield Case("parts")
    yield Case("compile", repeats=1)
    yield Case("memory", n=300_000, width=1600, height=1200, channels=19, repeats=1)


_N_ROUNDS = 3
"""Number of rounds in which the smallest scene is measured, see the module's docstring."""


def cases_in_rounds(quick: bool) -> Iterator[Case]:
    """Yield all `cases`, with those of the smallest scene, except the reference, in further rounds.

    The cases of the larger scenes are distributed between the rounds, so that the rounds are minutes apart.
    """
    all_cases = list(cases(quick))
    large = [case for case in all_cases if (case.n, case.width) != (20_000, 640)]
    small = [case for case in all_cases if case not in large]
    yield from small
    repeated = [case for case in small if case.what not in ("reference", "parts", "accuracy")]
    for number in range(1, _N_ROUNDS):
        share = len(large) // (_N_ROUNDS - 1)
        yield from large[(number - 1) * share : number * share if number < _N_ROUNDS - 1 else None]
        yield from repeated


def combine_rounds(what: str, first: dict[str, float], second: dict[str, float]) -> dict[str, float]:
    """Return the best figures of two rounds of a case: the smaller value of each.

    Figures that are divided by each other are taken from one round: the one with the faster blending, or the one in
    which plain arithmetic gained more from a second core.
    """
    if what == "blend":
        return min(first, second, key=lambda figures: figures["cpu_ms"])
    if what == "speed_up":
        return max(first, second, key=lambda figures: figures["one_fma_ms"] / figures["two_fma_ms"])
    return {name: min(value, second[name]) for name, value in first.items()}


def measure(case: Case) -> dict[str, float]:
    """Measure `case` in a fresh process and return its figures."""
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", **(_AVX2 if case.avx2 else {})}
    if case.what == "scalar":
        environment |= _NUMBA_DEFAULTS
    command = [sys.executable, "-m", "benchmarks.raster_case", json.dumps(asdict(case))]
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if process.returncode:
        raise SystemExit(f"{case} failed:\n{process.stderr}")
    figures: dict[str, float] = json.loads(process.stdout.splitlines()[-1])
    return figures


def table(results: list[tuple[Case, dict[str, float]]]) -> str:
    """Return the table of all scenes in Markdown."""
    figures_of = dict(results)
    lines = [
        "| Gaussians | image | K | cpu, 1 thread | 2 threads: CPU | 2 threads: wall | AVX2 only | blending alone "
        "| scalar, unblocked Numba | torch reference | arithmetic floor | pairs | pairs/s |",
        "| ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]

    def cell(case: Case, key: str = "cpu_ms") -> str:
        matches = [figures for other, figures in results if _same(other, case)]
        return f"{matches[0][key]:,.1f}" if matches else "-"

    def _same(a: Case, b: Case) -> bool:
        return {**asdict(a), "repeats": 0} == {**asdict(b), "repeats": 0}

    for case in figures_of:
        if case.what != "cpu" or case.threads != 1 or case.avx2:
            continue
        size = {"n": case.n, "width": case.width, "height": case.height, "channels": case.channels}
        own = figures_of[case]
        lines.append(
            f"| {case.n:,} | {case.width}x{case.height} | {case.channels} | **{own['cpu_ms']:,.1f}** "
            f"| {cell(Case('cpu', threads=2, **size))} | {cell(Case('cpu', threads=2, **size), 'wall_ms')} "
            f"| {cell(Case('cpu', avx2=True, **size))} | {cell(Case('blend', **size))} "
            f"| {cell(Case('scalar', **size))} "
            f"| {cell(Case('reference', **size))} | {cell(Case('blend', **size), 'floor_ms')} | {own['pairs']:,.0f} "
            f"| {own['pairs'] / own['cpu_ms'] / 1e3:,.1f} M |"
        )
    return "\n".join(lines)


def figures(results: list[tuple[Case, dict[str, float]]], opensplat: Sequence[tuple[str, float, str]] = ()) -> str:
    """Return the table of ratios and other figures with their goals, among them those measured with OpenSplat."""
    figures_of = {(c.what, c.n, c.width, c.channels, c.threads, c.avx2): f for c, f in results}

    def cpu(what: str = "cpu", k: int = 19, avx2: bool = False) -> float:
        return figures_of[(what, 20_000, 640, k, 1, avx2)]["cpu_ms"]

    blend = figures_of[("blend", 20_000, 640, 19, 1, False)]
    threads = next(f for c, f in results if c.what == "speed_up")
    step = next(f for c, f in results if c.what == "step")
    compiled = next(f for c, f in results if c.what == "compile")
    memory = next(f for c, f in results if c.what == "memory")
    accuracy = next(f for c, f in results if c.what == "accuracy")
    allowed = 1024 * 300_000 + 200 * 1600 * 1200
    gain, possible_gain = (threads[f"one_{what}_ms"] / threads[f"two_{what}_ms"] for what in ("wall", "fma"))
    rows = [
        ("RGB+16: our blending / arithmetic floor", blend["cpu_ms"] / blend["floor_ms"], "<= 2.8"),
        *opensplat,
        ("RGB+16: scalar, unblocked Numba / our blending", cpu("scalar") / cpu("blend"), "-"),
        ("RGB+16: scalar, unblocked Numba without projection / ours with projection", cpu("scalar") / cpu(), "-"),
        ("RGB+16 / RGB", cpu() / cpu(k=3), "<= 2.3"),
        ("RGB+16: one thread / two threads, alternately, wall time", gain, ">= 1.8 on an idle machine"),
        ("plain arithmetic: one thread / two threads, alternately, 2 on an idle machine", possible_gain, "-"),
        (
            "RGB+16: gain from a second thread / that of plain arithmetic",
            gain / possible_gain,
            ">= 0.9, which is 1.8 of 2",
        ),
        ("RGB+16: AVX2 only / all instructions of this processor", cpu(avx2=True) / cpu(), "<= 1.5"),
        ("whole RGB step / RGB forward and backward pass", step["cpu_ms"] / cpu(k=3), "<= 4"),
        ("RGB+16: relative error of a gradient, median of all Gaussians", accuracy["median"], "<= 1e-5"),
        ("RGB+16: relative error of a gradient, 99.9th percentile of all Gaussians", accuracy["99.9 %"], "<= 1e-3"),
        ("memory / (1 KB per Gaussian + 200 B per pixel)", memory["bytes"] / allowed, "<= 1"),
        ("first compilation in two processes, wall s", compiled["first_wall_s"], "<= 12 on an idle machine"),
        ("first compilation, CPU s of both processes with the imports of the second", compiled["first_cpu_s"], "-"),
        ("loading compiled kernels, CPU s", compiled["cached_cpu_s"], "<= 1"),
    ]
    lines = ["| figure | measured | goal |", "| --- | ---: | --- |"]
    return "\n".join(lines + [f"| {name} | {_format(value)} | {goal} |" for name, value, goal in rows])


def opensplat_rows(theirs: StepTimes, ours: StepTimes) -> list[tuple[str, float, str]]:
    """Return the rows of a comparison with OpenSplat; the goal is that of a whole step of RGB."""
    name = f"RGB training step, {ours.n_gaussians:,} Gaussians: OpenSplat / ours"
    return [
        (f"{name}, CPU time", theirs.cpu_ms / ours.cpu_ms, ">= 25"),
        (f"{name}, wall time", theirs.wall_ms / ours.wall_ms, "-"),
    ]


def _format(value: float) -> str:
    return f"{value:.2f}" if value >= 0.01 else f"{value:.1e}"


def growth(results: list[tuple[Case, dict[str, float]]]) -> str:
    """Return the exponents of power laws fitted to the CPU times of one thread with 19 channels."""
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
    """Return the table of the parts of a training step."""
    step = next(f for c, f in results if c.what == "step")
    lines = ["| part of an RGB step, 20,000 Gaussians, 640x480 | CPU ms |", "| --- | ---: |"]
    for case, values in results:
        if case.what == "parts":
            lines += [f"| {name} | {value:.1f} |" for name, value in values.items()]
    return "\n".join([*lines, f"| whole step | {step['cpu_ms']:.1f} |"])


def main() -> None:
    """Measure and print the tables, and put them into a document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="measure only 20,000 Gaussians at 640x480")
    parser.add_argument("--document", type=Path, help="put the tables between the marks of this document")
    parser.add_argument(
        "--opensplat", type=Path, nargs=2, metavar=("PROGRAM", "PROJECT"),
        help="also compare a training step with this program of OpenSplat on a folder with images/ and sparse/0/",
    )  # fmt: skip
    arguments = parser.parse_args()
    opensplat = opensplat_rows(*compare_steps(*arguments.opensplat)) if arguments.opensplat else []
    best: dict[Case, dict[str, float]] = {}
    for case in cases_in_rounds(arguments.quick):
        round_figures = measure(case)
        best[case] = combine_rounds(case.what, best[case], round_figures) if case in best else round_figures
        print(case, round_figures, file=sys.stderr, flush=True)
    results = list(best.items())
    peak = max(f["peak_gflops"] for c, f in results if c.what == "blend")
    text = [
        f"Measured on {platform.machine()}, {os.cpu_count()} virtual cores, shared; {peak:.0f} GFLOP/s on one core.",
        table(results), figures(results, opensplat), growth(results), parts(results),
    ]  # fmt: skip
    print_table("\n\n".join(text), arguments.document, "cost")


if __name__ == "__main__":
    main()
