"""Result of a batch: as text, as JSON values, and as one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any
from urllib.parse import quote

from ...delivery.report import STYLE, Html, fill, joined
from ...pipeline.stages import STAGES
from ..jobs import format_seconds
from .folder_state import FolderState

_COLUMNS = ("folder", "state", "computed", "kept", "restarts", "time", "CPU s")


def summary_as_dict(folders: Sequence[FolderState], notes: Sequence[str], seconds: float) -> dict[str, Any]:
    """Return the summary as JSON values.

    Parameters
    ----------
    notes : sequence of str
        Sentences about the whole batch.
    seconds : float
        Wall seconds of the batch.
    """
    return {
        "version": 1,
        "seconds": seconds,
        "cpu_seconds": sum(one.cpu_seconds for one in folders),
        "states": {state: sum(one.state == state for one in folders) for state in ("done", "failed", "stopped")},
        "twice": [one.name for one in folders if _twice(one)],
        "notes": list(notes),
        "folders": [{**asdict(one), "photos": str(one.photos), "out": str(one.out)} for one in folders],
    }


def _twice(folder: FolderState) -> list[str]:
    """Return the stages that this batch computed more than once."""
    return sorted({stage for stage in folder.computed if folder.computed.count(stage) > 1}, key=STAGES.index)


def _row(folder: FolderState) -> tuple[str, ...]:
    kept = [stage for stage in folder.done if stage not in folder.computed]
    return (
        folder.name, folder.state, " ".join(dict.fromkeys(folder.computed)) or "-", " ".join(kept) or "-",
        str(folder.restarts), format_seconds(folder.seconds), f"{folder.cpu_seconds:.0f}",
    )  # fmt: skip


def _head(folders: Sequence[FolderState]) -> str:
    done = sum(one.state == "done" for one in folders)
    text = f"{done} of {len(folders)} folders are done"
    for state in ("failed", "stopped"):
        n = sum(one.state == state for one in folders)
        text += f", {n} {state}" if n else ""
    return text + "."


def _sentences(folders: Sequence[FolderState], notes: Sequence[str]) -> list[str]:
    found = list(notes)
    for one in folders:
        found += [f"{one.name}: {note}" for note in one.notes]
        found += [f"{one.name}: done twice: {', '.join(_twice(one))}."] if _twice(one) else []
        found += [f"{one.name}: {one.state}: {one.error}"] if one.error else []
    return found


def summary_text(folders: Sequence[FolderState], notes: Sequence[str]) -> str:
    """Return a table with one row for each folder, and what is to be said below it.

    Parameters
    ----------
    notes : sequence of str
        Sentences about the whole batch.
    """
    rows = [_COLUMNS, *(_row(one) for one in folders)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_COLUMNS))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*lines, "", _head(folders), *_sentences(folders, notes)])


def summary_page(folders: Sequence[FolderState], notes: Sequence[str], seconds: float) -> str:
    """Return the summary as an HTML page that loads no other file; see `summary_as_dict` for the parameters."""
    head = fill("<tr>{}</tr>", joined(fill("<th>{}</th>", name) for name in _COLUMNS))
    rows = []
    for one in folders:
        _, *cells = _row(one)
        name: Html = fill("{}", one.name)
        if "report" in one.done:
            # Relative: the page is in the folder of the projects.
            name = fill('<a href="{}">{}</a>', f"{quote(one.name)}/report/report.html", one.name)
        rows.append(fill("<tr>{}</tr>", joined(fill("<td>{}</td>", cell) for cell in (name, *cells))))
    said = joined(fill("<li>{}</li>", sentence) for sentence in _sentences(folders, notes))
    return fill(
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>Batch</title>'
        "<style>{style}</style></head><body><main><header><p>Gaussian Heritage batch</p><h1>{head}</h1></header>"
        "<p>{time} in all.</p><table>{table}</table><ul>{said}</ul></main></body></html>\n",
        style=Html(STYLE), head=_head(folders), time=format_seconds(seconds), table=joined([head, *rows]), said=said,
    )  # fmt: skip
