"""The evaluation of objects as Markdown: means over the objects, then every object."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterator, Sequence
from pathlib import Path

from .. import __version__
from ..machine import describe_machine
from ..project_folder import atomic_write
from .isolation import Evaluation, Row, mean_of
from .settings import SeedKind

__all__ = ["markdown", "write_evaluation"]

_MEASURES = "IoU | BIoU | halo | stray | holes | Gaussians | PSNR dB | seconds"
_RIGHT = " | ".join(["---:"] * 8)
_ASKED: dict[SeedKind, str] = {
    "mask": "its true mask in the photo, outside of those compared, that shows it largest and whole",
    "click": "a click in the middle of its true mask, in the photo outside of those compared that shows it largest",
    "text": "its text; of several finds the first counts",
}


def markdown(evaluation: Evaluation) -> str:
    """Return the tables and the remarks."""
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
        way = row.way if row.found else f"{row.way} (**not found**)"
        lines.append(f"| {_cell(row.object)} | {way} | {row.n_views} | {_cells([row])} |")
    remarks = list(_remarks(evaluation))
    return "\n".join([*lines, *([""] + remarks if remarks else [])])


def write_evaluation(path: Path, evaluation: Evaluation, *, title: str, command: str) -> None:
    """Write a Markdown file, atomically.

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
    text = (
        f"# {title}: how well objects are isolated\n\n```\n{command}\n```\n\n{markdown(evaluation)}\n\n"
        f"{_explanation(evaluation)}\n\n"
        f"Gaussian Heritage {__version__}, {machine.cores} cores, {platform.system()} {platform.machine()}.\n"
    )
    with atomic_write(path, "w") as stream:
        stream.write(text)


def _explanation(evaluation: Evaluation) -> str:
    photos, trained = evaluation.photos, evaluation.n_trained_on
    seen = f"training saw {trained} of them" if trained else "training saw none of them"
    return (
        f"{evaluation.n_gaussians:,} Gaussians; {len(photos)} photos with true masks ({evaluation.layout}) are "
        f"compared, and {seen}: {', '.join(photos)}. Every object is asked for with "
        f"{_ASKED[evaluation.settings.seed]}. It is compared where it is more than half of what one sees, occluded "
        "by the rest of the scene, in the frame of the photo.\n\n"
        "- IoU, BIoU: in percent as in Gaussian Grouping's script, means over the views of an object and then over "
        "the objects; the boundary is the band inside of a mask that is 0.02 of the picture's diagonal wide. "
        "What was not found counts 0 (that script skips it).\n"
        "- halo: pixels outside of the true mask, up to that band's width away from it; stray: those farther away; "
        "holes: true pixels that are missing. In percent of the true mask's pixels.\n"
        "- Gaussians: IoU of the Gaussians with those that truly belong, by the true masks of all photos, in percent; "
        "none where masks do not say of every pixel what it shows.\n"
        "- PSNR: of the object alone over black with the photo, over the true mask.\n"
        "- seconds: wall time from the prompt to the Gaussians, every view rendered anew; loading a model counts for "
        "the first that needs it."
    )


def _cells(rows: Sequence[Row]) -> str:
    shares = [
        [row.iou for row in rows], [row.boundary_iou for row in rows], [row.halo for row in rows],
        [row.stray for row in rows], [row.holes for row in rows], [row.gaussian_iou for row in rows],
    ]  # fmt: skip
    cells = [_number(100 * mean_of(values)) for values in shares]
    cells += [_number(mean_of([row.psnr for row in rows])), _number(mean_of([row.seconds for row in rows]))]
    return " | ".join(cells)


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _remarks(evaluation: Evaluation) -> Iterator[str]:
    for row in evaluation.rows:
        if row.remark:
            yield f"- {row.object}, {row.way}: {row.remark}"
    for name in evaluation.left_out:
        yield f"- {name}: left out, no photo is left to compare it in."
    if evaluation.unplaced:
        yield f"- Left out, since no camera is known: {', '.join(evaluation.unplaced)}."
