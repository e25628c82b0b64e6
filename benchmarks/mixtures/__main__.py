"""Mixtures of kinds with a known truth: ``python -m benchmarks.mixtures [--cases 300] [--first 0] [--doc FILE.md]``.

Exit status 1 when a case is silently wrong.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import textwrap
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ..documents import print_table
from .cases import REPORTED, RIGHT, WRONG, Outcome, run_case

_WIDTH = 140
"""Longest line of the document, in characters."""


def table_of(outcomes: Sequence[Outcome]) -> str:
    """Return the table of outcomes, how many cases had each kind, and the seeds of silently wrong cases."""
    results = Counter(one.result for one in outcomes)
    kinds = Counter(kind for one in outcomes for kind in one.kinds)
    wrong_kinds = Counter(kind for one in outcomes for kind in one.kinds if one.result == WRONG)
    cells = []
    for kind in sorted(kinds, key=str.casefold):
        wrong = f" ({wrong_kinds[kind]} wrong)" if wrong_kinds[kind] else ""
        cells.append(f"`{kind}` {kinds[kind]}{wrong}")
    seeds = ", ".join(str(one.seed) for one in outcomes if one.result == WRONG)
    return "\n".join(
        [
            "| cases | right | reported | silently wrong |",
            "| ---: | ---: | ---: | ---: |",
            f"| {len(outcomes)} | {results[RIGHT]} | {results[REPORTED]} | {results[WRONG]} |",
            "",
            *textwrap.wrap(f"Cases with each kind: {', '.join(cells)}.", _WIDTH, break_on_hyphens=False),
            "",
            f"Seeds of silently wrong cases: {seeds or 'none'}.",
        ]
    )


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
    print_table(table_of(outcomes), options.doc, "mixtures")
    return int(any(outcome.result == WRONG for outcome in outcomes))


if __name__ == "__main__":
    raise SystemExit(main())
