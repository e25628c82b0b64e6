"""Measures how fast `verify` is beside ``sha256sum``, and what a package costs; ``make bench-packages`` calls it.

Timings depend on the machine, which the table names. Both programs read the same files from the memory of the system,
in turn, so that other work slows both.

example: python -m benchmarks.packages --project out/museum_room/project --doc docs/records.md
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from engine.core.system import cpu_seconds, describe_machine
from engine.delivery.packages import verify_package, write_package
from engine.delivery.packages.bag import write_bag
from engine.delivery.records import EXAMPLE_ADDRESS
from engine.project.folder import ProjectFolder
from engine.project.objects import list_objects

from .documents import print_table

N_ROUNDS = 7
LARGE_BYTES, N_SMALL, SMALL_BYTES = 512 << 20, 2000, 20_000
"""A package with a large scene, and one with many pictures."""


def main() -> int:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--project", type=Path, required=True, help="a project folder with objects")
    parser.add_argument("--doc", type=Path, required=True)
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for what, sizes in (
            (f"one file of {LARGE_BYTES >> 20} MiB", [LARGE_BYTES]),
            (f"{N_SMALL} files of {SMALL_BYTES // 1000} kB", [SMALL_BYTES] * N_SMALL),
        ):
            folder = write_package_of(Path(name) / str(len(rows)), sizes)
            ours, theirs = in_turn(lambda folder=folder: verify(folder), lambda folder=folder: sha256sum(folder))
            beside = f"`sha256sum --check`: {theirs:.2f} s"
            rows.append(f"| `verify`, {what} | {ours:.2f} s | {beside} | {theirs / ours:.0%} | 80 % |")
        seconds, size = package_cost(options.project, Path(name) / "packages")
        rows.append(f"| `package`, an object of the museum room | {seconds:.1f} CPU s | {size / 1e6:.1f} MB | | |")
    body = "\n\n".join(
        [
            f"Machine: {describe_machine().name}, shared with other work. Median of {N_ROUNDS} rounds in turn, CPU "
            "seconds, files in the memory of the system. Nothing was chosen by these figures.",
            "| what | here | beside it | speed | figure |\n| --- | ---: | ---: | ---: | ---: |\n" + "\n".join(rows),
        ]
    )
    print_table(body, options.doc, "packages")
    return 0


def write_package_of(folder: Path, sizes: list[int]) -> Path:
    """Write a package with files of random bytes and return its folder."""
    rng = np.random.default_rng(0)
    data = folder / "data"
    data.mkdir(parents=True)
    for number, size in enumerate(sizes):
        (data / f"{number}.bin").write_bytes(rng.bytes(size))
    write_bag(folder, {})
    return folder


def verify(folder: Path) -> None:
    assert verify_package(folder).is_intact


def sha256sum(folder: Path) -> None:
    command = ["sha256sum", "--check", "--quiet", "manifest-sha256.txt"]
    subprocess.run(command, cwd=folder, check=True)


def in_turn(ours: Callable[[], None], theirs: Callable[[], None]) -> tuple[float, float]:
    """Return the median CPU seconds of both, of this process and of the child process."""
    taken: tuple[list[float], list[float]] = ([], [])
    for _ in range(N_ROUNDS):
        start = time.process_time()
        ours()
        taken[0].append(time.process_time() - start)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        theirs()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken[1].append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return float(np.median(taken[0])), float(np.median(taken[1]))


def package_cost(project: Path, out: Path) -> tuple[float, int]:
    """Return CPU seconds and bytes of the package of the first object, after one to compile the kernels."""
    opened = ProjectFolder.open_existing(project)
    name = list_objects(project)[0].id
    made = write_package(out / "first", opened, name, address=EXAMPLE_ADDRESS)
    start = cpu_seconds()
    made = write_package(out / "second", opened, name, address=EXAMPLE_ADDRESS)
    seconds = cpu_seconds() - start
    return seconds, sum(path.stat().st_size for path in made.rglob("*") if path.is_file())


if __name__ == "__main__":
    sys.exit(main())
