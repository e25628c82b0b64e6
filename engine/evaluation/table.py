"""The evaluation of objects as Markdown: means over the objects, then every object."""

from __future__ import annotations

import math
import platform
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from .. import __version__
from ..machine import describe_machine
from ..project_folder import atomic_write
from .document import write_section
from .isolation import Evaluation, Row, mean_of
from .picture import curve_picture
from .settings import SeedKind

__all__ = ["INTRODUCTION", "MEANINGS", "markdown", "write_evaluation"]

_MEASURES = "IoU | BIoU | halo | stray | holes | Gaussians | PSNR dB | CPU s | wall s"
_RIGHT = " | ".join(["---:"] * 9)
_ASKED: dict[SeedKind, str] = {
    "mask": "its true mask in the photo, outside of those compared, that shows it largest and whole",
    "click": "a click in the middle of its true mask, in the photo outside of those compared that shows it largest",
    "text": (
        "its text; of several finds the first counts, or as many as there are equal objects, each for the one that it "
        "is most like"
    ),
}
_BY: dict[SeedKind, str] = {"mask": "true masks", "click": "clicks", "text": "texts"}

INTRODUCTION = """# How well objects are isolated

Every section was written by the command above its table."""

MEANINGS = """## What the columns mean

- IoU, BIoU: in percent as in Gaussian Grouping's script, means over the views of an object and then over the objects;
  the boundary is the band inside of a mask that is 0.02 of the picture's diagonal wide. What was not found counts 0
  (that script skips it).
- halo: pixels outside of the true mask, up to that band's width away from it; stray: those farther away; holes: true
  pixels that are missing. In percent of the true mask's pixels.
- Gaussians: IoU of the Gaussians with those that truly belong, by the true masks of all photos, in percent; none where
  masks do not say of every pixel what it shows.
- PSNR: of the object alone over black with the photo, over the true mask.
- CPU s, wall s: from the prompt to the Gaussians, every view rendered anew; loading a model counts for the first that
  needs it."""


def markdown(evaluation: Evaluation) -> str:
    """Return the tables and the remarks: means over the objects for every way, and each object for the presets."""
    rows = evaluation.rows
    ways = list(dict.fromkeys(row.way for row in rows))
    objects = list(dict.fromkeys(row.object for row in rows))
    lines = [f"| mean of {len(objects)} objects | not found | {_MEASURES} |", f"| --- | ---: | {_RIGHT} |"]
    for way in ways:
        of_way = [row for row in rows if row.way == way]
        missing = sum(not row.found for row in of_way)
        lines.append(f"| {way} | {missing} | {_cells(of_way)} |")
    lines += ["", f"| object | way | views | {_MEASURES} |", f"| --- | --- | ---: | {_RIGHT} |"]
    for row in rows:
        if row.way not in evaluation.settings.presets:
            continue
        way = row.way if row.found else f"{row.way} (**not found**)"
        lines.append(f"| {_cell(row.object)} | {way} | {row.n_views} | {_cells([row])} |")
    remarks = list(_remarks(evaluation))
    return "\n".join([*lines, *([""] + remarks if remarks else [])])


def write_evaluation(path: Path, evaluation: Evaluation, *, title: str, command: str) -> None:
    """Write one section of a Markdown file, and a picture beside it; sections of other titles stay.

    Parameters
    ----------
    path : Path
    evaluation : Evaluation
    title : str
        Of the scene.
    command : str
        That made the table, stands above it.

    Raises
    ------
    DiskError
        When it cannot be written.
    """
    machine = describe_machine()
    seed = evaluation.settings.seed
    image = path.with_name(f"{path.stem}_{re.sub('[^0-9A-Za-z_-]+', '-', title)}_{seed}.png")
    with atomic_write(image) as stream:
        stream.write(curve_picture(evaluation))
    body = (
        f"```\n{command}\n```\n\n{markdown(evaluation)}\n\n![How well against how long]({image.name})\n\n"
        f"{_conditions(evaluation)}\n\n"
        f"Gaussian Heritage {__version__}, {machine.cores} cores, {platform.system()} {platform.machine()}."
    )
    heading = f"{title}, asked for by {_BY[seed]}"
    write_section(path, introduction=INTRODUCTION, title=heading, body=body, closing=MEANINGS)


def _conditions(evaluation: Evaluation) -> str:
    photos, trained = evaluation.photos, evaluation.n_trained_on
    seen = f"training saw {trained} of them" if trained else "training saw none of them"
    stages = ", ".join(f"{stage} {wall:.0f} s ({cpu:.0f})" for stage, wall, cpu in evaluation.stages)
    return (
        f"{evaluation.n_gaussians:,} Gaussians; {len(photos)} photos with true masks ({evaluation.layout}) are "
        f"compared, and {seen}: {', '.join(photos)}. Every object is asked for with "
        f"{_ASKED[evaluation.settings.seed]}. It is compared where it is more than half of what one sees, occluded "
        "by the rest of the scene, in the frame of the photo."
        + (f" Before the first prompt, in wall (CPU) seconds: {stages}." if stages else "")
    )


def _cells(rows: Sequence[Row]) -> str:
    shares = [
        [row.iou for row in rows], [row.boundary_iou for row in rows], [row.halo for row in rows],
        [row.stray for row in rows], [row.holes for row in rows], [row.gaussian_iou for row in rows],
    ]  # fmt: skip
    cells = [_number(100 * mean_of(values)) for values in shares]
    columns = ([row.psnr for row in rows], [row.cpu_seconds for row in rows], [row.seconds for row in rows])
    cells += [_number(mean_of(values)) for values in columns]
    return " | ".join(cells)


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _remarks(evaluation: Evaluation) -> Iterator[str]:
    for row in evaluation.rows:
        if row.remark and row.way in evaluation.settings.presets:
            yield f"- {row.object}, {row.way}: {row.remark}"
    for name in evaluation.left_out:
        yield f"- {name}: left out, no photo is left to compare it in."
    if evaluation.unplaced:
        yield f"- Left out, since no camera is known: {', '.join(evaluation.unplaced)}."
