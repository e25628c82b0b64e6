"""Time of the same folders with one and two workers, and what scheduling takes."""

from __future__ import annotations

import shutil
from pathlib import Path

from .photo_folders import write_folders
from .runs import Finished, finished_batch

_WAYS = {
    "two workers of one core": ("--workers=2", "--threads=1"),
    "one worker of one core": ("--workers=1", "--threads=1"),
    "one worker of two cores": ("--workers=1", "--threads=2"),
}


def speed_table(folder: Path, n_folders: int, n_photos: int, preset: str) -> str:
    """Run the batch in each way and return the table."""
    photos = write_folders(folder / "scans", n_folders, n_photos)
    # Measures the speed of this machine, once for each number of cores, and compiles the kernels.
    for number, options in enumerate(_WAYS.values()):
        finished_batch(photos[:1], folder / f"warm_{number}", f"--preset={preset}", "--no-objects", *options)
    ran: dict[str, Finished] = {}
    for way, options in _WAYS.items():
        out = folder / "scenes"
        ran[way] = finished_batch(photos, out, f"--preset={preset}", "--no-objects", *options)
        if ran[way].code or ran[way].summary["twice"]:
            raise RuntimeError(f"{way}: code {ran[way].code}, {ran[way].summary['notes']}")
        print(way, f"{ran[way].seconds:.1f} s", flush=True)
        shutil.rmtree(out)
    two, one, wide = ran.values()
    rows = [
        f"| {way} | {run.seconds:.0f} | {run.all_cpu:.0f} | {run.own_cpu:.2f} | {run.own_cpu / run.all_cpu:.2%} |"
        for way, run in ran.items()
    ]
    return "\n".join([
        f"{n_folders} folders of {n_photos} photos of 384 x 288 pixels, preset `{preset}`, without objects.",
        "",
        "| workers | wall s | CPU s of all | CPU s of scheduler and client | share |",
        "| --- | ---: | ---: | ---: | ---: |",
        *rows,
        "",
        "| ratio of wall time | measured | goal |",
        "| --- | ---: | ---: |",
        f"| two workers of one core, against one of one core | {one.seconds / two.seconds:.2f} | 1.7 |",
        f"| two workers of one core, against one of two cores | {wide.seconds / two.seconds:.2f} | 1.0 |",
        "",
    ])  # fmt: skip
