"""Train photo sets on the processor and tabulate the error: ``python -m benchmarks.training``.

It trains as the plan does for a user who chooses a preset: a table beside gsplat, and a picture of error against
seconds. Cameras and masks of a set are made once. A stopped run continues. Results of another state of the engine are
kept, and are not mixed with these. Single settings are varied by ``python -m benchmarks.training.card train``.

example: python -m benchmarks.training --sets herz_jesus25,banana16
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Collection, Sequence
from itertools import product
from pathlib import Path

from engine.core.errors import HeritageError
from engine.core.files import atomic_write
from engine.training.settings import PRESETS

from ..documents import print_table
from .photo_sets import NAMES, REAL_SETS, SCENES, photo_set
from .presets_plot import presets_plot
from .running import Measured, TrainingBench
from .table import presets_table

PRESETS_PART = "presets on the processor"
"""Name of the table in a document."""

_DEFAULT_SETS = (*REAL_SETS, *SCENES)


def main(arguments: Sequence[str] | None = None) -> None:
    """Train, measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--presets", type=_of(PRESETS), default=["preview", "standard"], help="(default: both)")
    parser.add_argument("--sets", type=_of(NAMES), default=list(_DEFAULT_SETS), help=f"of {', '.join(NAMES)}")
    parser.add_argument("--seeds", default="0", metavar="N,N", help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("out/training"), help="(default: %(default)s)")
    parser.add_argument("--measured-only", action="store_true", help="train nothing: tell what is measured so far")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="document for the table")
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="file for a picture of error against seconds")
    options = parser.parse_args(arguments)
    try:
        results = _measured(options)
    except HeritageError as error:
        sys.exit(str(error))
    print_table(presets_table(results), options.doc, PRESETS_PART)
    if options.picture:
        with atomic_write(options.picture) as stream:
            stream.write(presets_plot(results))


def _of(names: Collection[str]) -> Callable[[str], list[str]]:
    """Return a type of argument: some of `names` with commas between."""

    def chosen(text: str) -> list[str]:
        unknown = [name for name in text.split(",") if name not in names]
        if unknown:
            raise argparse.ArgumentTypeError(f"there is no {unknown[0]!r}, only {', '.join(names)}")
        return text.split(",")

    return chosen


def _measured(options: argparse.Namespace) -> dict[tuple[str, str], list[Measured]]:
    """Return the figures by set and preset, one for each seed."""
    bench, begin = TrainingBench(options.out), time.monotonic()
    results: dict[tuple[str, str], list[Measured]] = {}
    sets, seeds = [photo_set(name) for name in options.sets], [int(text) for text in options.seeds.split(",")]
    for photos, preset, seed in product(sets, options.presets, seeds):
        how = bench.stored if options.measured_only else bench.measured
        found = how(photos, preset, seed)
        if found is None:
            continue
        results.setdefault((photos.name, preset), []).append(found)
        minutes, what = (time.monotonic() - begin) / 60, f"{photos.name}, {preset}, seed {seed}"
        sys.stderr.write(f"[{minutes:6.1f} min] {what}: {found.psnr:.2f} dB, {found.cpu_seconds:.0f} CPU s\n")
    return results


if __name__ == "__main__":
    main()
