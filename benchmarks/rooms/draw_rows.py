"""What each draw found in its test rooms, in one row. Rows stay when the results of the rooms are deleted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import fmean
from typing import Any

from engine.core.files import read_json, write_json
from engine.quality.evaluation.results import FOUND_IOU, WHOLE_IOU

from .draws import Draw
from .results import read_result

ROWS_FILE = Path("benchmarks/rooms/draw_rows.json")
"""Relative to the repository."""
_METHOD, _PAPER = "better", "paper"
_ADVICE = "Restore it with git."


@dataclass(frozen=True)
class DrawRow:
    """Figures of the preset ``better`` over all test rooms of a draw; counts but for the means.

    Attributes
    ----------
    objects, words, absent : int
        Objects of the rooms, words for them, and words for absent things.
    iou, boundary_iou, paper_iou : float
        By mask, means over the rooms in percent; ``paper_iou`` is that of the preset ``paper``.
    whole : int
        By mask, objects with an IoU of at least `WHOLE_IOU`.
    all_found, all_whole, all_false : int
        Find all: objects with at least `FOUND_IOU`, with at least `WHOLE_IOU`, and results that are no object.
    words_found, words_whole, words_ranked, refused : int
        Words whose object has at least `FOUND_IOU` and `WHOLE_IOU`, words that the detector ranks first on the true
        masks, and refused words for absent things.
    """

    objects: int
    words: int
    absent: int
    iou: float
    boundary_iou: float
    paper_iou: float
    whole: int
    all_found: int
    all_whole: int
    all_false: int
    words_found: int
    words_whole: int
    words_ranked: int
    refused: int


def row_of(results: Sequence[dict[str, Any]]) -> DrawRow:
    """Return the row of a draw from the results of all of its test rooms."""
    masks = [result["mask"][_METHOD] for result in results]
    found = [one for result in results for one in result["all"][_METHOD]["objects"]]
    words = [one for result in results for one in result["text"][_METHOD]["words"]]
    absent = [one for result in results for one in result["text"][_METHOD]["absent"]]

    def mean(rooms: Sequence[Sequence[dict[str, Any]]], name: str) -> float:
        return round(100 * fmean(fmean(one[name] for one in room) for room in rooms), 1)

    def count(ones: Sequence[dict[str, Any]], least: float) -> int:
        return sum(one["iou"] >= least for one in ones)

    return DrawRow(
        objects=sum(map(len, masks)),
        words=len(words),
        absent=len(absent),
        iou=mean(masks, "iou"),
        boundary_iou=mean(masks, "boundary_iou"),
        paper_iou=mean([result["mask"][_PAPER] for result in results], "iou"),
        whole=sum(count(room, WHOLE_IOU) for room in masks),
        all_found=count(found, FOUND_IOU),
        all_whole=count(found, WHOLE_IOU),
        all_false=sum(result["all"][_METHOD]["n_false"] for result in results),
        words_found=count(words, FOUND_IOU),
        words_whole=count(words, WHOLE_IOU),
        words_ranked=sum(word == first for result in results for word, first in (result["ceiling"] or {}).items()),
        refused=sum(one["refused"] for one in absent),
    )


def read_rows(repository: Path, draws: Sequence[Draw]) -> dict[Draw, DrawRow]:
    """Return the rows of the draws that were measured whole: from the rooms' results, otherwise as kept.

    Raises
    ------
    FormatError
        When a result or the kept rows cannot be read.
    """
    file = repository / ROWS_FILE
    schema = {str: {field.name: float if field.type == "float" else int for field in fields(DrawRow)}}
    kept = read_json(file, schema, advice=_ADVICE) if file.exists() else {}
    rows = {}
    for draw in draws:
        results = [read_result(repository, draw.commit, room.name) for room in draw.test_rooms]
        if all(results):
            rows[draw] = row_of([result for result in results if result])
        elif draw.commit in kept:
            rows[draw] = DrawRow(**kept[draw.commit])
    return rows


def write_rows(repository: Path, rows: dict[Draw, DrawRow]) -> None:
    """Keep the rows.

    Raises
    ------
    DiskError
        When they cannot be written.
    """
    write_json(repository / ROWS_FILE, {draw.commit: asdict(row) for draw, row in rows.items()})
