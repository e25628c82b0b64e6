"""``python -m benchmarks.batch PART``: each part prints its table, and puts it into docs/batch.md."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

from engine.core.system import describe_machine

from ..documents import print_table
from .runs import ROOT


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure one part, and write its table between its two marks in the document."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.batch", description=__doc__)
    parser.add_argument("part", choices=("speed", "kills", "split", "simulation"))
    parser.add_argument("--folders", type=int, default=8, help="photo folders (default: %(default)s)")
    parser.add_argument("--photos", type=int, default=8, help="photos of each (default: %(default)s)")
    parser.add_argument("--preset", default="preview", help="of the speed (default: %(default)s)")
    parser.add_argument("--kills", type=int, default=100, help="workers to kill (default: %(default)s)")
    parser.add_argument("--prompts", default="", help="of the kills: objects to isolate; default: without objects")
    parser.add_argument("--minutes", type=float, default=120.0, help="begin no batch later (default: %(default)s)")
    parser.add_argument("--workers", default="1,2,4", help="of the split: how many (default: %(default)s)")
    parser.add_argument("--cores-each", type=int, default=1, help="cores of each of them (default: %(default)s)")
    parser.add_argument("--first-core", type=int, default=0, help="of the split (default: %(default)s)")
    parser.add_argument("--work", type=Path, default=Path("out/split"), help="of the split (default: %(default)s)")
    parser.add_argument("--doc", type=Path, help="document whose table is replaced")
    options = parser.parse_args(arguments)
    folder = Path(tempfile.mkdtemp(prefix="heritage-batch-"))
    os.environ["GAUSSIAN_HERITAGE_CALIBRATION"] = str(folder / "calibration.json")
    if options.part == "speed":
        from .speed import speed_table

        text = speed_table(folder, options.folders, options.photos, options.preset)
    elif options.part == "kills":
        from .kills import kills_table

        text = kills_table(folder, options.folders, options.photos, options.kills, options.minutes, options.prompts)
    elif options.part == "split":
        from .split import measure_split, split_table

        for workers in map(int, options.workers.split(",")):
            # Each keeps itself on the cores of its first worker.
            measuring = get_context("spawn").Process(
                target=measure_split, args=(options.work, workers, options.cores_each, options.first_core)
            )
            measuring.start()
            measuring.join()
        text = split_table(options.work)
    else:
        from .simulation import simulation_table

        text = simulation_table(ROOT / "demo" / "museum_room" / "photos")
    command = " ".join(["python -m benchmarks.batch", *(arguments or sys.argv[1:])])
    text = f"Made by `{command}` on {describe_machine().cores} cores that other programs used as well.\n\n{text}"
    print_table(text, options.doc, options.part + (" with objects" if options.prompts else ""))
    shutil.rmtree(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
