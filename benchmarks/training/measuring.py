"""All trainings of one photo set, in a process of its own where several sets are trained at a time."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from .photo_sets import PhotoSetFolder
from .pictures import write_error_picture
from .running import Measured, TrainingBench
from .variants import VARIANTS


def measure_set(
    bench: TrainingBench, photos: PhotoSetFolder, variants: Sequence[str], seeds: Sequence[int], *, pictures: bool
) -> dict[tuple[str, str], list[Measured]]:
    """Train and measure variants of a set, one after the other, as they share cameras and masks.

    Parameters
    ----------
    bench : TrainingBench
    photos : PhotoSetFolder
    variants : sequence of str
        Names in `VARIANTS`.
    seeds : sequence of int
    pictures : bool
        Whether to write a picture of the errors beside each training.

    Returns
    -------
    dict
        Figures by set and variant, one for each seed.

    Raises
    ------
    HeritageError
        As the stages of the pipeline.
    """
    results: dict[tuple[str, str], list[Measured]] = {}
    begin = time.monotonic()
    for variant in [VARIANTS[name] for name in variants]:
        for seed in seeds:
            measured = bench.measured(photos, variant, seed)
            results.setdefault((photos.name, variant.name), []).append(measured)
            minutes = (time.monotonic() - begin) / 60
            what = f"{photos.name}, {variant.name}, seed {seed}"
            sys.stderr.write(f"[{minutes:6.1f} min] {what}: {measured.psnr:.2f} dB, {measured.cpu_seconds:.0f} CPU s\n")
            if pictures:
                folder = bench.folder(photos, variant, seed)
                cameras = bench.out / "scenes" / photos.name / "cameras"
                write_error_picture(folder, cameras, photos.photos, folder / "error.png")
    return results
