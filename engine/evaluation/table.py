"""Markdown tables of an evaluation: means over the objects, then every object."""

from __future__ import annotations

import math
import platform
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from .. import __version__
from ..files import atomic_write
from ..machine import describe_machine
from .document import write_section
from .isolation import Evaluation, Row, mean_of
from .picture import curve_picture
from .settings import PromptKind

__all__ = ["INTRODUCTION", "MEANINGS", "markdown", "write_evaluation"]

_MEASURES = "IoU | BIoU | halo | stray | holes | Gaussians | PSNR dB | CPU s | wall s"
_RIGHT = " | ".join(["---:"] * 9)
_PROMPTS: dict[PromptKind, str] = {
    "mask": "its true mask in the photo that shows it largest and whole among those not compared",
    "click": "a click in the middle of its true mask, in the photo that shows it largest among those not compared",
    "text": (
        "its text; of several results the first counts. Equal objects share a text: as many results as there are "
        "objects count, each for the object that it matches best"
    ),
}
_PROMPTED_BY: dict[PromptKind, str] = {"mask": "true masks", "click": "clicks", "text": "texts"}

INTRODUCTION = """# Segmentation of objects

The command above each table writes the whole section."""

MEANINGS = """## What the columns mean

- IoU, BIoU: as in the script of Gaussian Grouping, in percent; means over the views of an object, then over all
  objects. The boundary is the band inside of a mask with a width of 0.02 of the picture's diagonal. Objects that were
  not found count 0 (that script skips them).
- halo: predicted pixels outside of the true mask within that band's width; stray: those farther away; holes: missing
  pixels of the true mask. All in percent of the true mask's pixels.
- Gaussians: IoU with the Gaussians of the object, determined from the true masks of all photos, in percent. Empty where
  the masks do not label every pixel.
- PSNR: between the object rendered alone on black and the photo, within the true mask.
- CPU s, wall s: from the prompt to the Gaussians. All views are rendered for each object; loading a model counts for
  the first object that needs it."""


def markdown(evaluation: Evaluation) -> str:
    """Return the tables and remarks: means over the objects for every method, and each object for the presets."""
    rows = evaluation.rows
    methods = list(dict.fromkeys(row.method for row in rows))
    objects = list(dict.fromkeys(row.object for row in rows))
    lines = [f"| mean of {len(objects)} objects | not found | {_MEASURES} |", f"| --- | ---: | {_RIGHT} |"]
    for method in methods:
        of_way = [row for row in rows if row.method == method]
        missing = sum(not row.found for row in of_way)
        lines.append(f"| {method} | {missing} | {_cells(of_way)} |")
    lines += ["", f"| object | method | views | {_MEASURES} |", f"| --- | --- | ---: | {_RIGHT} |"]
    for row in rows:
        if row.method not in evaluation.settings.presets:
            continue
        method = row.method if row.found else f"{row.method} (**not found**)"
        lines.append(f"| {_cell(row.object)} | {method} | {row.n_views} | {_cells([row])} |")
    remarks = list(_remarks(evaluation))
    return "\n".join([*lines, *([""] + remarks if remarks else [])])


def write_evaluation(path: Path, evaluation: Evaluation, *, title: str, command: str) -> None:
    """Write one section of a Markdown file and its plot beside it; other sections stay unchanged.

    Parameters
    ----------
    path : Path
    evaluation : Evaluation
    title : str
        Name of the scene.
    command : str
        Command that makes the table, shown above it.

    Raises
    ------
    DiskError
        When the file cannot be written.
    """
    machine = describe_machine()
    prompt_kind = evaluation.settings.prompt_kind
    image = path.with_name(f"{path.stem}_{re.sub('[^0-9A-Za-z_-]+', '-', title)}_{prompt_kind}.png")
    with atomic_write(image) as stream:
        stream.write(curve_picture(evaluation))
    body = (
        f"```\n{command}\n```\n\n{markdown(evaluation)}\n\n![IoU against CPU seconds]({image.name})\n\n"
        f"{_conditions(evaluation)}\n\n"
        f"Gaussian Heritage {__version__}, {machine.cores} cores, {platform.system()} {platform.machine()}."
    )
    heading = f"{title}, prompted by {_PROMPTED_BY[prompt_kind]}"
    write_section(path, introduction=INTRODUCTION, title=heading, body=body, closing=MEANINGS)


def _conditions(evaluation: Evaluation) -> str:
    photos, trained = evaluation.photos, evaluation.n_trained_on
    seen = f"training saw {trained} of them" if trained else "training saw none of them"
    stages = ", ".join(f"{stage} {wall:.0f} s ({cpu:.0f})" for stage, wall, cpu in evaluation.stages)
    return (
        f"{evaluation.n_gaussians:,} Gaussians; {len(photos)} photos with true masks ({evaluation.layout}) are "
        f"compared; {seen}: {', '.join(photos)}. The prompt for every object is "
        f"{_PROMPTS[evaluation.settings.prompt_kind]}. A predicted mask holds the pixels of the photo of which the "
        "object makes up more than half, with the rest of the scene in front of it."
        + (f" Stages before the first prompt, in wall (CPU) seconds: {stages}." if stages else "")
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
        if row.remark and row.method in evaluation.settings.presets:
            yield f"- {row.object}, {row.method}: {row.remark}"
    for name in evaluation.left_out:
        yield f"- {name}: left out, since no photo is left to compare it in."
    if evaluation.unplaced:
        yield f"- Left out, since no camera is known: {', '.join(evaluation.unplaced)}."
