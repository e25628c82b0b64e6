"""Tables of the random rooms: means over the rooms with standard errors, every room, and a row for each draw."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from engine.quality.evaluation import INTRODUCTION, MEANINGS, write_section

from .draw_rows import DrawRow, read_rows, write_rows
from .draws import CHOOSING_ROOMS, SHORT_COMMIT, Draw, Room
from .results import METHODS, Figures, figures_of, read_result

_ROOMS_TITLE, _DRAWS_TITLE = "Random rooms", "Random rooms: every draw"

_CHOOSING, _TEST, _MODELS = "choosing (*in sample*)", "test (*test*)", "of models (*test*)"
_MASK = (("mIoU", "iou"), ("mBIoU", "boundary_iou"), ("whole %", "whole"))
_CLICK = (
    ("found %", "click_found"),
    ("whole %", "click_whole"),
    ("mIoU", "click_iou"),
    ("mBIoU", "click_boundary_iou"),
)
_WORD = (
    ("found %", "words_found"),
    ("whole %", "words_whole"),
    ("mean IoU", "word_iou"),
    ("absent refused %", "refused"),
    ("ceiling %", "ceiling"),
    ("median s", "word_seconds"),
)
_ALL = (("found %", "all_found"), ("whole %", "all_whole"), ("mean IoU", "all_iou"), ("false finds", "false_finds"))
_SCENE = (("test PSNR dB", "psnr"), ("minutes per room", "minutes"))
_ROOM = (*_MASK, *_CLICK[:3], *_WORD[:5], *_ALL, *_SCENE)

_EXPLANATION = """\
Means over the rooms ± standard error over the rooms. A room has 24 photos of 480x360 and true cameras, and is trained
with the preset `standard`; the rooms of the draws up to 68546ccc had at most 15,000 instead of 40,000 Gaussians, a
setting that no user can choose. Photos that training never saw are compared. The choosing rooms are *in sample*:
settings may be chosen on them. The seeds of the test rooms follow from the hash of the commit that froze the method, so
nothing was chosen on them. Exhibits of rooms *of models* are 3D models of other people (`make model-rooms`).

- By mask: as in the sections above. Whole: with an IoU of at least 0.85.
- By click: on the pixel of the true mask that is farthest from its border, in the photo of the mask.
- By word: a word is found when the IoU of its object is at least 0.5, and whole from 0.85 on. The mean IoU is over all
  words, with 0 for a refused one. Absent refused: words for things that the room does not show and that found nothing.
  Ceiling: words that the detector ranks first on the true mask's crop. Seconds are wall seconds per word after the
  first, which loads the models; the worst is that of all rooms.
- Find all, which only `better` can do: objects with a result of an IoU of at least 0.5, and results per room that are
  no object. Results that mostly cover furniture count neither as right nor as wrong.
- Minutes: wall time on two cores from the seed to the result, with rendering; the first rooms of 24ae1b4b shared them
  with much other work, idle ones took 8 to 18 minutes. The other rooms were trained and measured on two cores each of
  another machine, with Python 3.12 and PyTorch 2.11 in place of 3.11 and 2.13. A dash stands for what was not measured,
  or not measured whole because the run was interrupted."""


_DRAWS = """\
**Test**: each row is of the preset `better` of its commit in five rooms (*test*) whose seeds follow from the hash of
that commit, as it was measured then, up to 68546ccc with at most 15,000 Gaussians a room. Draws differ by more than
methods do, since their rooms do. Found words are also given in percent of those that the detector ranks first on the
true masks."""


@dataclass(frozen=True)
class _Version:
    """A frozen method in a table: the name of its rows, and its commit."""

    name: str
    commit: str


@dataclass(frozen=True)
class _Measured:
    """Results of one version in the choosing rooms or in the test rooms, by room, None where missing."""

    version: _Version
    rooms: str
    results: dict[Room, dict[str, Any] | None]

    @property
    def missing(self) -> list[str]:
        return [room.name for room, result in self.results.items() if result is None]

    def figures(self, method: str) -> dict[Room, Figures]:
        """Return the figures of the measured rooms."""
        found = {room: figures_of(result, method) for room, result in self.results.items() if result is not None}
        return {room: figures for room, figures in found.items() if figures is not None}


def rooms_section(repository: Path, draws: Sequence[Draw]) -> str:
    """Return the section of the draws whose rooms have results, without its heading.

    Parameters
    ----------
    repository : Path
    draws : sequence of Draw
        All draws. Those without the result of any room are left out.

    Raises
    ------
    FormatError
        When a result cannot be read.
    """
    measured = []
    for draw in draws:
        version = _Version(f"{draw.reason} {draw.commit[:SHORT_COMMIT]}", draw.commit)
        for kind, rooms in ((_CHOOSING, CHOOSING_ROOMS), (_TEST, draw.test_rooms), (_MODELS, draw.model_rooms)):
            one = _Measured(version, kind, {room: read_result(repository, draw.commit, room.name) for room in rooms})
            if len(one.missing) < len(one.results):
                measured.append(one)
    if not measured:
        return "```\nmake test-rooms\n```\n\nNo room is measured yet."
    parts = [
        "```\nmake test-rooms\n```",
        *_remarks(measured),
        "**By mask**\n\n" + _means(measured, _MASK),
        "**By click**\n\n" + _means(measured, _CLICK),
        "**By word**\n\n" + _means(measured, _WORD, worst=True),
        "**Find all, and the scene**\n\n" + _means(measured, (*_ALL, *_SCENE)),
        f"**Every room, `{METHODS[-1]}`**\n\n" + _every_room(measured),
    ]
    return "\n\n".join([*parts, _EXPLANATION])


def draws_section(rows: Mapping[Draw, DrawRow]) -> str:
    """Return the section with a row for each draw, without its heading."""
    names = (
        "objects", "by mask: mIoU", "mBIoU", "more than `paper`", "whole %", "find all: found %", "whole %",
        "false ones an object", "words: found %", "whole %", "of those ranked first %", "absent refused %",
    )  # fmt: skip
    lines = [f"| drawn | commit | method | {' | '.join(names)} |", f"| --- | --- | --- |{' ---: |' * len(names)}"]
    for draw, row in rows.items():
        shares = (
            row.iou, row.boundary_iou, row.iou - row.paper_iou, 100 * row.whole / row.objects,
            100 * row.all_found / row.objects, 100 * row.all_whole / row.objects, row.all_false / row.objects,
            100 * row.words_found / row.words, 100 * row.words_whole / row.words,
            100 * row.words_found / max(row.words_ranked, 1), 100 * row.refused / row.absent,
        )  # fmt: skip
        digits = (1, 1, 1, 0, 0, 0, 2, 0, 0, 0, 0)
        cells = [str(row.objects), *(f"{share:.{n}f}" for share, n in zip(shares, digits, strict=True))]
        lines.append(f"| {draw.date} | {draw.commit[:SHORT_COMMIT]} | {_cell(draw.reason)} | {' | '.join(cells)} |")
    return "\n\n".join(
        ["```\npython -m benchmarks.rooms table --doc docs/segmentation.md\n```", _DRAWS, "\n".join(lines)]
    )


def write_tables(document: Path, repository: Path, draws: Sequence[Draw]) -> None:
    """Write both sections into a document, whose other sections stay, and keep the rows of the draws.

    Raises
    ------
    FormatError, DiskError
        When a result or the document cannot be read, or the document cannot be written.
    """
    rows = read_rows(repository, draws)
    write_rows(repository, rows)
    for title, body in ((_ROOMS_TITLE, rooms_section(repository, draws)), (_DRAWS_TITLE, draws_section(rows))):
        write_section(document, introduction=INTRODUCTION, title=title, body=body, closing=MEANINGS)


def _remarks(measured: Sequence[_Measured]) -> Iterator[str]:
    for one in measured:
        if one.missing:
            left_out = "so it is in no mean" if len(one.missing) == 1 else "so they are in no mean"
            yield f"Not measured yet with {one.version.name}: {', '.join(one.missing)}, {left_out}."
    pictures: dict[str, set[str]] = {}
    for one in measured:
        for room, result in one.results.items():
            if result is not None:
                pictures.setdefault(room.name, set()).add(result["pictures"])
    differing = [name for name, hashes in pictures.items() if len(hashes) > 1]
    if differing:
        yield f"The versions were measured on different renderings of {', '.join(differing)}."
    machines = {
        f"{result['machine']['cores']} cores, {result['machine']['system']}"
        for one in measured
        for result in one.results.values()
        if result is not None
    }
    if machines:
        yield f"Measured on {' and on '.join(sorted(machines))}."


def _means(measured: Sequence[_Measured], columns: Sequence[tuple[str, str]], *, worst: bool = False) -> str:
    names = [name for name, _ in columns] + (["worst s"] if worst else [])
    lines = [f"| rooms | version | method | {' | '.join(names)} |", f"| --- | --- | --- |{' ---: |' * len(names)}"]
    for one in measured:
        for method in METHODS:
            figures = list(one.figures(method).values())
            if all(getattr(room, columns[0][1]) is None for room in figures):
                continue
            cells = [_mean([getattr(room, field) for room in figures]) for _, field in columns]
            if worst:
                seconds = [room.worst_seconds for room in figures if room.worst_seconds is not None]
                cells.append(_number(max(seconds, default=None)))
            lines.append(
                f"| {_rooms(one, len(figures))} | {_cell(one.version.name)} | {method} | {' | '.join(cells)} |"
            )
    return "\n".join(lines)


def _every_room(measured: Sequence[_Measured]) -> str:
    kinds = ["mask: "] * len(_MASK) + ["click: "] * 3 + ["word: "] * 5 + ["all: "] * len(_ALL) + [""] * len(_SCENE)
    names = [kind + name for kind, (name, _) in zip(kinds, _ROOM, strict=True)]
    lines = [f"| room | objects | {' | '.join(names)} |", f"| --- | ---: |{' ---: |' * len(names)}"]
    for one in measured:
        for room, figures in one.figures(METHODS[-1]).items():
            cells = [_number(getattr(figures, field)) for _, field in _ROOM]
            lines.append(f"| {room.name} | {figures.n_objects} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _rooms(one: _Measured, n_measured: int) -> str:
    count = str(n_measured) if n_measured == len(one.results) else f"{n_measured} of {len(one.results)}"
    return f"{count} {one.rooms}"


def _mean(values: Sequence[float | None]) -> str:
    """Return the mean over the rooms with its standard error, and over how many rooms where some have no value."""
    numbers = [value for value in values if value is not None]
    if not numbers:
        return "-"
    text = _number(statistics.fmean(numbers))
    if len(numbers) > 1:
        text += f" ± {_number(statistics.stdev(numbers) / math.sqrt(len(numbers)))}"
    return text if len(numbers) == len(values) else f"{text} ({len(numbers)} room{'s' if len(numbers) > 1 else ''})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
