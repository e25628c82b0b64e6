"""Train variants of the method on photo sets and tabulate what they gain: ``python -m benchmarks.training``.

Cameras and masks of each set are made once. A stopped run continues. Results of another state of the engine are kept,
and are not mixed with these.

example: python -m benchmarks.training --sets herz_jesus25,banana16 --variants as-planned,detached --seeds 0
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from engine.core.errors import EnvironmentProblem, HeritageError
from engine.quality.evaluation import write_section
from engine.quality.evaluation.settings import MARKS

from .measuring import measure_set
from .photo_sets import NAMES, REAL_SETS, SCENES, photo_set
from .running import TrainingBench
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
    bench = TrainingBench(options.out, preset=options.preset, objects=options.objects)
    variants, seeds = options.variants.split(","), [int(text) for text in options.seeds.split(",")]
    # Forked processes would inherit torch's threads in an unknown state.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context) as pool:
        jobs = [pool.submit(measure_set, bench, one, variants, seeds, pictures=options.pictures) for one in sets]
        try:
            for job in as_completed(jobs):
                job.result()
        except BrokenProcessPool as error:
            text = "A training process was ended from outside, perhaps for lack of memory. Run again with --jobs 1."
            raise EnvironmentProblem(text) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
        results = {key: measured for job in jobs for key, measured in job.result().items()}
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


if __name__ == "__main__":
    main()
