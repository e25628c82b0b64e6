"""Tables of a draw from the stored results: means over the rooms with standard errors, then every room."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from engine.evaluation import INTRODUCTION, MEANINGS, write_section

from .draws import CHOOSING_ROOMS, N_TEST_ROOMS, SHORT_COMMIT, Draw, Room
from .results import METHODS, Figures, figures_of, read_result

__all__ = ["draw_section", "draw_title", "write_tables"]

_CHOOSING, _TEST = "choosing (*in sample*)", "test (*test*)"
_MASK = (("mIoU", "iou"), ("mBIoU", "boundary_iou"))
_WORD = (
    ("found %", "words_found"),
    ("mean IoU", "word_iou"),
    ("absent refused %", "refused"),
    ("ceiling %", "ceiling"),
    ("median s", "word_seconds"),
)
_ALL = (("found %", "all_found"), ("mean IoU", "all_iou"), ("false finds", "false_finds"))
_SCENE = (("test PSNR dB", "psnr"), ("minutes per room", "minutes"))
_ROOM = (*_MASK, *_WORD[:4], *_ALL, *_SCENE)

_EXPLANATION = """\
Means over the rooms ± standard error over the rooms. A room has 24 photos of 480x360, true cameras and at most 15,000
Gaussians, and is otherwise trained with the preset `standard`. Photos that training never saw are compared. The
choosing rooms are *in sample*: settings may be chosen on them. The seeds of the test rooms follow from the hash of the
commit that froze the method, so nothing was chosen on them.

- By mask: as in the sections above.
- By word: a word is found when the IoU of its object is at least 0.5. The mean IoU is over all words, with 0 for a
  refused one. Absent refused: words for things that the room does not show and that found nothing. Ceiling: words that
  the detector ranks first on the true mask's crop. Seconds are wall seconds per word after the first, which loads the
  models; the worst is that of all rooms.
- Find all, which only `better` can do: objects with a result of an IoU of at least 0.5, and results per room that are
  no object. Results that mostly cover furniture count neither as right nor as wrong.
- Minutes: wall time on two cores from the seed to the result, with rendering. A dash stands for what was not measured,
  or not measured whole because the run was interrupted."""


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


def draw_title(draw: Draw) -> str:
    """Return the title of the section of a draw."""
    return f"Random rooms, draw {draw.commit[:SHORT_COMMIT]}: {draw.reason}"


def draw_section(repository: Path, draws: Sequence[Draw], draw: Draw) -> str:
    """Return the section of one draw without its heading.

    Parameters
    ----------
    repository : Path
    draws : sequence of Draw
        All draws; the first is the baseline.
    draw : Draw

    Raises
    ------
    FormatError
        When a result cannot be read.
    """
    measured = [
        _Measured(version, kind, {room: read_result(repository, version.commit, room.name) for room in rooms})
        for kind, rooms in ((_CHOOSING, CHOOSING_ROOMS), (_TEST, draw.test_rooms))
        for version in _versions(draws, draw)
    ]
    seeds = ", ".join(map(str, draw.seeds))
    head = (
        f"```\nmake test-rooms\n```\n\nThe commit {draw.commit[:SHORT_COMMIT]} was frozen on {draw.date}. Seeds of its "
        f"{N_TEST_ROOMS} test rooms: {seeds}."
    )
    parts = [head, *_remarks(measured)]
    if any(len(one.missing) < len(one.results) for one in measured):
        parts += [
            "**By mask**\n\n" + _means(measured, _MASK),
            "**By word**\n\n" + _means(measured, _WORD, worst=True),
            "**Find all**\n\n" + _means(measured, _ALL),
            "**Scene**\n\n" + _scene(measured),
            "**Every room**\n\n" + _every_room(measured),
        ]
    return "\n\n".join([*parts, _EXPLANATION])


def write_tables(document: Path, repository: Path, draws: Sequence[Draw]) -> None:
    """Write the section of every draw into a document, whose other sections stay.

    Raises
    ------
    FormatError, DiskError
        When a result or the document cannot be read, or the document cannot be written.
    """
    for draw in draws:
        body = draw_section(repository, draws, draw)
        write_section(document, introduction=INTRODUCTION, title=draw_title(draw), body=body, closing=MEANINGS)


def _versions(draws: Sequence[Draw], draw: Draw) -> list[_Version]:
    baseline = draws[0]
    versions = [_Version(f"baseline {baseline.commit[:SHORT_COMMIT]}", baseline.commit)]
    if draw.commit != baseline.commit:
        versions.append(_Version(f"{draw.reason} {draw.commit[:SHORT_COMMIT]}", draw.commit))
    return versions


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


def _scene(measured: Sequence[_Measured]) -> str:
    """Return the table of what does not depend on the method that isolates objects."""
    names = [name for name, _ in _SCENE]
    lines = [f"| rooms | version | {' | '.join(names)} |", f"| --- | --- |{' ---: |' * len(names)}"]
    for one in measured:
        figures = list(one.figures(METHODS[0]).values())
        if figures:
            cells = [_mean([getattr(room, field) for room in figures]) for _, field in _SCENE]
            lines.append(f"| {_rooms(one, len(figures))} | {_cell(one.version.name)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _every_room(measured: Sequence[_Measured]) -> str:
    mask, word, everything = len(_MASK), len(_WORD) - 1, len(_ALL)
    kinds = ["mask: "] * mask + ["word: "] * word + ["all: "] * everything + [""] * len(_SCENE)
    names = [kind + name for kind, (name, _) in zip(kinds, _ROOM, strict=True)]
    lines = [
        f"| room | version | method | objects | {' | '.join(names)} |",
        f"| --- | --- | --- | ---: |{' ---: |' * len(names)}",
    ]
    rooms = dict.fromkeys(room for one in measured for room in one.results)
    for room in rooms:
        for one in (one for one in measured if room in one.results):
            for method in METHODS:
                figures = one.figures(method).get(room)
                if figures is not None:
                    cells = [_number(getattr(figures, field)) for _, field in _ROOM]
                    lines.append(
                        f"| {room.name} | {_cell(one.version.name)} | {method} | {figures.n_objects} | "
                        f"{' | '.join(cells)} |"
                    )
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
    return text if len(numbers) == len(values) else f"{text} ({len(numbers)} rooms)"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
