"""``stability``: errors of float32 compared with float64, and results of training, in stiff and extreme cases."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.events import Emit, Finished, StopCheck

NAME = "stability"
HELP = "Compare rasterizer, loss and optimiser with float64, and train, in stiff and extreme cases."
EXAMPLE = "python -m engine stability --case needle_1e6"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="also write the table there")
    parser.add_argument("--case", metavar="NAME", help="run only this case")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Run the cases and return the exit code, which is 1 if a row is red."""
    from ...quality.stability import run_cases, select_cases, suite_markdown, write_table

    rows = run_cases(select_cases(options.case), emit=emit, should_stop=should_stop)
    if options.out is not None:
        write_table(options.out, rows)
    red = [row.case.name for row in rows if not row.green]
    outputs = {"red": red, **({"table": str(options.out)} if options.out is not None else {})}
    emit(Finished(suite_markdown(rows), outputs))
    return 1 if red else 0
