"""Train variants of the method on photo sets and tabulate what they gain: ``python -m benchmarks.training``.

Cameras and masks of each set are made once. A stopped run continues. Results of another state of the engine are kept,
and are not mixed with these.

example: python -m benchmarks.training --sets herz_jesus25,banana16 --variants as-planned,detached --seeds 0
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from engine.errors import HeritageError
from engine.evaluation import write_section
from engine.evaluation.settings import MARKS

from .photo_sets import NAMES, REAL_SETS, SCENES, PhotoSetFolder, photo_set
from .pictures import write_error_picture
from .running import Measured, TrainingBench
from .table import details, overview
from .variants import VARIANTS

_DEFAULT_SETS = (*REAL_SETS, *SCENES)

_REFERENCES = """gsplat's figures are means of three seeds at the end of the run (`benchmarks/training/reference.py`);
those of commit 06f55961 are of one run each."""


def main() -> None:
    """Train, measure, print the tables, and write them to the file given by ``--doc``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", default=",".join(_DEFAULT_SETS), help=f"of {', '.join(NAMES)} (default: %(default)s)")
    parser.add_argument("--variants", default="as-planned", help=f"of {', '.join(VARIANTS)} (default: %(default)s)")
    parser.add_argument("--seeds", default="0", metavar="N,N", help="(default: %(default)s)")
    parser.add_argument("--preset", default="standard", choices=("preview", "standard"), help="(default: %(default)s)")
    parser.add_argument("--objects", action="store_true", help="evaluate objects, too, where there is ground truth")
    parser.add_argument("--pictures", action="store_true", help="write pictures of the errors beside the trainings")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="sets at a time (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("out/training"), help="(default: %(default)s)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="file for the section")
    parser.add_argument("--title", default="Training on all photo sets", help="of the section (default: %(default)s)")
    options = parser.parse_args()
    unknown = [name for name in options.variants.split(",") if name not in VARIANTS]
    if unknown:
        parser.error(f"there is no variant {unknown[0]!r}, only {', '.join(VARIANTS)}")
    if options.jobs < 1:
        parser.error(f"--jobs must be at least 1, got {options.jobs}")
    try:
        _run(options)
    except HeritageError as error:
        sys.exit(str(error))


def _run(options: argparse.Namespace) -> None:
    sets = [photo_set(name) for name in options.sets.split(",")]
    begin = time.monotonic()
    # Forked processes would inherit torch's threads in an unknown state.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context) as pool:
        jobs = [pool.submit(_measure_set, photos, options, begin) for photos in sets]
        for job in as_completed(jobs):
            if job.exception() is not None:
                pool.shutdown(wait=False, cancel_futures=True)
                job.result()
        results = {key: found for job in jobs for key, found in job.result().items()}
    options_text = f"--sets {options.sets} --variants {options.variants} --seeds {options.seeds}"
    options_text += "" if options.preset == "standard" else f" --preset {options.preset}"
    options_text += " --objects" if options.objects else ""
    body = "\n\n".join([
        f"```\npython -m benchmarks.training {options_text}\n```", MARKS["in sample"], overview(results), _REFERENCES,
        details(results),
    ])  # fmt: skip
    sys.stdout.write(f"{body}\n")
    if options.doc:
        write_section(options.doc, title=options.title, body=body)


def _measure_set(
    photos: PhotoSetFolder, options: argparse.Namespace, begin: float
) -> dict[tuple[str, str], list[Measured]]:
    """Train and measure all variants of a set with all seeds, one after the other, as they share cameras and masks."""
    bench = TrainingBench(options.out, preset=options.preset, objects=options.objects)
    results: dict[tuple[str, str], list[Measured]] = {}
    for variant in [VARIANTS[name] for name in options.variants.split(",")]:
        for seed in [int(text) for text in options.seeds.split(",")]:
            measured = bench.measured(photos, variant, seed)
            results.setdefault((photos.name, variant.name), []).append(measured)
            minutes = (time.monotonic() - begin) / 60
            what = f"{photos.name}, {variant.name}, seed {seed}"
            sys.stderr.write(f"[{minutes:6.1f} min] {what}: {measured.psnr:.2f} dB, {measured.cpu_seconds:.0f} CPU s\n")
            if options.pictures:
                folder = bench.folder(photos, variant, seed)
                cameras = options.out / "scenes" / photos.name / "cameras"
                write_error_picture(folder, cameras, photos.photos, folder / "error.png")
    return results


if __name__ == "__main__":
    main()
