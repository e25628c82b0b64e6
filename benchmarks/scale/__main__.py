"""``python -m benchmarks.scale``: cameras of 25 to 1,000 photos, a process for each set; results of before are kept."""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from engine.core.engine_process import engine_command, engine_environment
from engine.core.system import describe_machine, usable_cores, use_cores

from ..documents import print_table
from .measuring import measure
from .sets import set_of
from .table import scale_table

_SETS = "building_25,building_50,museum_room,building_150,building_300"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what has no result yet, and print the table of all results."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale", description=__doc__)
    parser.add_argument("--sets", default=_SETS, help="default: %(default)s")
    parser.add_argument("--cores", type=int, default=2, help="cores to use (default: %(default)s)")
    parser.add_argument("--first-core", type=int, default=0, help="number of the first of them (default: %(default)s)")
    parser.add_argument("--work", type=Path, default=Path("out/scale"), help="default: %(default)s")
    parser.add_argument("--doc", type=Path, help="document whose part `scale` is replaced")
    parser.add_argument("--table", action="store_true", help="measure nothing")
    parser.add_argument("--only", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    results = options.work / "results"
    results.mkdir(parents=True, exist_ok=True)
    if options.only:
        return _measure_here(options.only, options)
    if not options.table:
        for name in options.sets.split(","):
            _measure(name, options)
    text = scale_table([json.loads(file.read_text(encoding="utf-8")) for file in sorted(results.glob("*.json"))])
    print_table(text, options.doc, "scale")
    return 0


def _file_of(name: str, options: argparse.Namespace) -> Path:
    return Path(options.work / "results" / f"{name}-{options.cores}.json")


def _measure(name: str, options: argparse.Namespace) -> None:
    """Measure in a process of its own, so that its peak memory is its own and a crash of COLMAP is told."""
    file = _file_of(name, options)
    if file.is_file():
        return
    command = engine_command(
        "--only", name, "--cores", options.cores, "--first-core", options.first_core, "--work", options.work,
        module="benchmarks.scale",
    )  # fmt: skip
    done = subprocess.run(command, env=engine_environment(), check=False)
    if done.returncode:
        sys.stderr.write(f"{name} on {options.cores} cores ended with {done.returncode}\n")


def _measure_here(name: str, options: argparse.Namespace) -> int:
    cores = usable_cores()[options.first_core : options.first_core + options.cores]
    if len(cores) < options.cores:
        sys.stderr.write(f"This computer has no {options.cores} cores from number {options.first_core} on.\n")
        return 1
    photos = set_of(name, options.work)  # on all cores, where photos have to be made
    use_cores(cores)
    folder = options.work / "sfm" / f"{name}-{options.cores}"
    # Seconds of a run that was stopped are not known.
    shutil.rmtree(folder, ignore_errors=True)
    found = {"name": name, "cores": options.cores, "machine": describe_machine().name, **measure(photos, folder)}
    _file_of(name, options).write_text(json.dumps(found, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
