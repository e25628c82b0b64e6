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
from engine.quality.evaluation import write_section

from ..pictures import psnr, read_picture
from ..places import blender_environments
from .likeness import engine_picture
from .processes import run_inside

TITLE = "Objects in Cycles"
PLACES = ("shown", "appended", "linked")
_SIDE = 480
"""Longest side of the pictures in pixels."""
_GOAL = 28.0
"""dB of a render beside what the viewport shows."""
_SEEN = 1.5 / 255
"""Least value of a pixel that is not black."""


def section(project: Path, work: Path, pictures: Path | None = None) -> str:
    """Render the objects of a project, and return the figures.

    Parameters
    ----------
    project : Path
    work : Path
        Folder for files.
    pictures : Path, optional
        PNG to write: a row for each object, the engine's picture and those of Cycles.
    """
    from PIL import Image

    blender = blender_environments()[-1]
    records = [one for one in list_objects(ProjectFolder.open_existing(project).path) if one.evidence]
    photos = {record.id: str(record.evidence[0]["photo"]) for record in records}
    asked = [f"{object_id}={photo}" for object_id, photo in photos.items()]
    done = run_inside(blender, "objects", project, str(_SIDE), work, *asked)
    lines, rows = [], []
    lowest = np.inf
    for record in records:
        expected = engine_picture(project, photos[record.id], _SIDE, work, record.id)
        found = [read_picture(work / f"{record.id}_{place}.png") for place in PLACES]
        rows.append(np.concatenate([expected, *found], axis=1))
        whole, seen = zip(*(_likeness(one, expected) for one in found), strict=True)
        lowest = min(lowest, *seen)
        name = f"{record.name}, with detail" if _has_detail(record) else record.name
        share = (expected.max(axis=2) > _SEEN).mean()
        figures = " | ".join(f"{one:.1f}" for one in (*seen, min(whole)))
        lines.append(f"| {name} | {photos[record.id]} | {share:.1%} | {figures} |")
    if pictures is not None:
        Image.fromarray((np.concatenate(rows) * 255 + 0.5).astype(np.uint8)).save(pictures)
    height, width = rows[0].shape[0], rows[0].shape[1] // (1 + len(PLACES))
    detailed = " ".join(record.id for record in records if _has_detail(record))
    before = f"python -m engine segment {project} --detail {detailed}\n" if detailed else ""
    return f"""```
{before}python -m benchmarks.blender.objects {project} --doc docs/blender_speed.md
```

PSNR in dB of a render by Cycles beside the picture by the engine's formula, which is what the viewports draw, of each
object alone from the photo that it was found in, {width} x {height} pixels, bpy {done["blender"]}: in the file of the
project, appended to a new file, and linked to one, each after *Set Up Render*. They are taken over the pixels that the
object covers in either picture, as the rest is black; the last column is the least of the three over all pixels.
{len(lines) * len(PLACES)} renders took {done["cpu"]:.0f} CPU s. Goal: {_GOAL:.0f} dB; the least is {lowest:.1f}
dB{"" if lowest >= _GOAL else ", **missed**"}.

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
    """Measure, and write the section."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("project", type=Path)
    parser.add_argument("--pictures", type=Path, help="PNG of all pictures to write")
    parser.add_argument("--doc", type=Path, help="file whose section is written")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        text = section(options.project, Path(work), options.pictures)
    print(text)
    if options.doc:
        write_section(options.doc, title=TITLE, body=text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
