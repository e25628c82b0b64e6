"""``stability``: how far float32 is from float64, and how training ends, in stiff and extreme cases."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..events import Emit, Finished, StopCheck

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "stability"
HELP = "Measure rasterizer, loss and optimiser against float64, and train, in stiff and extreme cases."
EXAMPLE = "python -m engine stability --case needle_1e6"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="also write the table there")
    parser.add_argument("--case", metavar="NAME", help="only this case")


def project_folder(options: argparse.Namespace) -> None:
    """No project, no log."""


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Run the cases; the exit code is 1 when a row is red."""
    from ..stability import markdown, run_cases, select, write_table

    rows = run_cases(select(options.case), emit=emit, should_stop=should_stop)
    if options.out is not None:
        write_table(options.out, rows)
    red = [row.case.name for row in rows if not row.green]
    outputs = {"red": red, **({"table": str(options.out)} if options.out is not None else {})}
    emit(Finished(markdown(rows), outputs))
    return 1 if red else 0
