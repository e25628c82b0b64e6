"""Command line of the benchmark of the cameras' health."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..documents import print_table
from .cases import photo_cases
from .running import run_case
from .table import table


def main() -> None:
    """Run the photo sets that have no stored outcome, and print or store the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.camera_health", description=__doc__)
    parser.add_argument(
        "--out", type=Path, default=Path("out/camera_health"), help="work folder (default: %(default)s)"
    )
    parser.add_argument("--only", default="", help="run only sets whose name contains this")
    parser.add_argument("--doc", type=Path, help="document to put the table into")
    arguments = parser.parse_args()
    cases = [case for case in photo_cases() if arguments.only in case.name]
    outcomes = [run_case(case, arguments.out / "sets", lambda line: print(line, flush=True)) for case in cases]
    print_table(table(outcomes), arguments.doc, "camera_health")


if __name__ == "__main__":
    main()
