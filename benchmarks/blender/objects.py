"""Renders of a project's objects by Cycles beside the formula of the viewports, also appended and linked.

Each object is seen from the photo that it was found in. The engine's picture of it is what the viewports draw (see
`likeness`).

example: python -m benchmarks.blender.objects out/museum_room/project --doc docs/blender_speed.md
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, list_objects

from ..documents import print_table
from ..pictures import psnr, read_picture
from ..places import blender_environments
from .likeness import engine_picture
from .processes import run_inside

PLACES = ("shown", "appended", "linked")
_SIDE = 480
"""Longest side of the pictures in pixels."""
_GOAL = 28.0
"""dB of a render beside what the viewport shows."""
_SEEN = 1.5 / 255
"""Least value of a pixel that is not black."""


def table(project: Path, work: Path) -> str:
    """Render the objects of a project, and return the figures.

    Parameters
    ----------
    project : Path
    work : Path
        Folder for files.
    """
    blender = blender_environments()[-1]
    records = [one for one in list_objects(ProjectFolder.open_existing(project).path) if one.evidence]
    photos = {record.id: str(record.evidence[0]["photo"]) for record in records}
    asked = [f"{object_id}={photo}" for object_id, photo in photos.items()]
    done = run_inside(blender, "objects", project, str(_SIDE), work, *asked)
    lines, lowest = [], np.inf
    for record in records:
        expected = engine_picture(project, photos[record.id], _SIDE, work, record.id)
        found = [read_picture(work / f"{record.id}_{place}.png") for place in PLACES]
        whole, seen = zip(*(_likeness(one, expected) for one in found), strict=True)
        lowest = min(lowest, *seen)
        name = f"{record.name}, with detail" if _has_detail(record) else record.name
        share = (expected.max(axis=2) > _SEEN).mean()
        figures = " | ".join(f"{one:.1f}" for one in (*seen, min(whole)))
        lines.append(f"| {name} | {photos[record.id]} | {share:.1%} | {figures} |")
    height, width = expected.shape[:2]
    return f"""\
{width} x {height} pixels, bpy {done["blender"]}. {len(lines) * len(PLACES)} renders took {done["cpu"]:.0f} CPU s.
Goal: {_GOAL:.0f} dB; the least is {lowest:.1f} dB{"" if lowest >= _GOAL else ", **missed**"}.

| object | photo | covers | {" | ".join(PLACES)} | all pixels |
| --- | --- | ---: |{" ---: |" * (len(PLACES) + 1)}
{chr(10).join(lines)}"""


def _likeness(picture: NDArray[np.float64], expected: NDArray[np.float64]) -> tuple[float, float]:
    """Return the PSNR over all pixels, and over those that are not black in both pictures."""
    seen = np.maximum(picture, expected).max(axis=2) > _SEEN
    return psnr(picture, expected), psnr(picture[seen], expected[seen])


def _has_detail(record: ObjectRecord) -> bool:
    return bool((record.detail or {}).get("kept"))


def main() -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("project", type=Path)
    parser.add_argument("--doc", type=Path, help="put the table between the marks of this document")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        print_table(table(options.project, Path(work)), options.doc, "objects")
    return 0


if __name__ == "__main__":
    sys.exit(main())
