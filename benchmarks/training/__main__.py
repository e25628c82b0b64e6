"""Train photo sets on the processor and tabulate the error: ``python -m benchmarks.training COMMAND``.

`presets` trains as the plan does for a user who chooses a preset: a table beside gsplat, and a picture of error against
seconds. `variants` exchanges parts of the method and tells what each gains. Cameras and masks of a set are made once. A
stopped run continues. Results of another state of the engine are kept, and are not mixed with these.

example: python -m benchmarks.training presets --sets herz_jesus25,banana16
         python -m benchmarks.training variants --sets herz_jesus25,banana16 --variants as-planned,detached --seeds 0,1
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

from ..documents import put_into
from .photo_sets import NAMES, REAL_SETS, SCENES, photo_set
from .pictures import write_error_picture
from .presets_plot import presets_plot
from .running import Measured, TrainingBench
from .table import presets_table, variants_table
from .variants import VARIANTS

PRESETS_PART = "presets on the processor"
"""Name of the table in a document."""

_DEFAULT_SETS = (*REAL_SETS, *SCENES)
_AS_PLANNED = "as-planned"


def main() -> None:
    """Train, measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    one = commands.add_parser("presets", help="presets as planned, beside gsplat")
    one.add_argument("--presets", type=_of(PRESETS), default=["preview", "standard"], help="(default: both)")
    one.add_argument("--doc", type=Path, metavar="FILE.md", help="document for the table")
    one.add_argument("--picture", type=Path, metavar="FILE.png", help="file for a picture of error against seconds")
    one.set_defaults(run=_presets)
    two = commands.add_parser("variants", help="parts of the method exchanged")
    two.add_argument("--variants", type=_of(VARIANTS), required=True, help=f"of {', '.join(VARIANTS)}")
    two.add_argument("--preset", default="standard", choices=PRESETS, help="(default: %(default)s)")
    two.add_argument("--pictures", action="store_true", help="write pictures of the errors beside the trainings")
    two.set_defaults(run=_variants)
    for command in (one, two):
        command.add_argument("--sets", type=_of(NAMES), default=list(_DEFAULT_SETS), help=f"of {', '.join(NAMES)}")
        command.add_argument("--seeds", default="0", metavar="N,N", help="(default: %(default)s)")
        command.add_argument("--out", type=Path, default=Path("out/training"), help="(default: %(default)s)")
        command.add_argument("--measured-only", action="store_true", help="train nothing: tell what is measured so far")
    options = parser.parse_args()
    try:
        options.run(options)
    except HeritageError as error:
        sys.exit(str(error))


def _of(names: Collection[str]) -> Callable[[str], list[str]]:
    """Return a type of argument: some of `names` with commas between."""

    def chosen(text: str) -> list[str]:
        unknown = [name for name in text.split(",") if name not in names]
        if unknown:
            raise argparse.ArgumentTypeError(f"there is no {unknown[0]!r}, only {', '.join(names)}")
        return text.split(",")

    return chosen


def _presets(options: argparse.Namespace) -> None:
    results = _measured(options, options.presets, [_AS_PLANNED])
    table = presets_table(results)
    sys.stdout.write(f"{table}\n")
    if options.doc:
        put_into(options.doc, PRESETS_PART, table)
    if options.picture:
        with atomic_write(options.picture) as stream:
            stream.write(presets_plot(results))


def _variants(options: argparse.Namespace) -> None:
    results = _measured(options, [options.preset], options.variants)
    sys.stdout.write(f"{variants_table(results)}\n")
    if options.pictures:
        bench = TrainingBench(options.out)
        for name, preset, variant in results:
            photos = photo_set(name)
            for seed in _seeds(options):
                folder = bench.folder(photos, preset, VARIANTS[variant], seed)
                write_error_picture(folder, bench.cameras(photos), photos.photos, folder / "error.png")


def _seeds(options: argparse.Namespace) -> list[int]:
    return [int(text) for text in options.seeds.split(",")]


def _measured(
    options: argparse.Namespace, presets: Sequence[str], variants: Sequence[str]
) -> dict[tuple[str, str, str], list[Measured]]:
    """Return the figures by set, preset and variant, one for each seed."""
    bench, begin = TrainingBench(options.out), time.monotonic()
    results: dict[tuple[str, str, str], list[Measured]] = {}
    sets = [photo_set(name) for name in options.sets]
    for photos, preset, variant, seed in product(sets, presets, variants, _seeds(options)):
        how = bench.stored if options.measured_only else bench.measured
        found = how(photos, preset, VARIANTS[variant], seed)
        if found is None:
            continue
        results.setdefault((photos.name, preset, variant), []).append(found)
        minutes, what = (time.monotonic() - begin) / 60, f"{photos.name}, {preset}, {variant}, seed {seed}"
        sys.stderr.write(f"[{minutes:6.1f} min] {what}: {found.psnr:.2f} dB, {found.cpu_seconds:.0f} CPU s\n")
    return results


if __name__ == "__main__":
    main()
