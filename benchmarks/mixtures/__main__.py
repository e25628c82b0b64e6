"""Mixtures of kinds with a known truth: ``python -m benchmarks.mixtures [--cases 300] [--first 0] [--doc FILE.md]``.

Exit status 1 when a case is silently wrong.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ..documents import put_into
from .cases import REFUSED, RIGHT, WRONG, Outcome, run_case

__all__ = ["main", "table_of"]


def table_of(outcomes: Sequence[Outcome]) -> str:
    """Return the table of outcomes by kind, and the seeds of silently wrong cases."""
    lines = ["| kind in the mixture | cases | right | told | silently wrong |"]
    lines.append("| --- | --- | --- | --- | --- |")
    kinds = sorted({kind for outcome in outcomes for kind in outcome.kinds}, key=str.casefold)
    for kind in (*kinds, "all"):
        counts = Counter(one.result for one in outcomes if kind == "all" or kind in one.kinds)
        total = sum(counts.values())
        lines.append(f"| {kind} | {total} | {counts[RIGHT]} | {counts[REFUSED]} | {counts[WRONG]} |")
    wrong = ", ".join(str(one.seed) for one in outcomes if one.result == WRONG)
    return "\n".join([*lines, "", f"Seeds of silently wrong cases: {wrong or 'none'}."])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mixtures", description=__doc__)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--doc", type=Path, help="document with the marks of the part `mixtures`")
    options = parser.parse_args(arguments)
    logging.disable(logging.WARNING)
    outcomes = []
    for seed in range(options.first, options.first + options.cases):
        with tempfile.TemporaryDirectory(prefix="mixture-") as work:
            outcome = run_case(seed, Path(work))
        outcomes.append(outcome)
        for sentence in outcome.sentences if outcome.result == WRONG else ():
            print(f"seed {seed}: {sentence}", flush=True)
    table = table_of(outcomes)
    print(table)
    if options.doc is not None:
        put_into(options.doc, "mixtures", table)
    return int(any(outcome.result == WRONG for outcome in outcomes))


if __name__ == "__main__":
    raise SystemExit(main())
