"""Markdown tables of an evaluation: figures of every method, then every object, word or result."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeVar

from ... import __version__
from ...core.files import write_file
from ...core.system import describe_machine, describe_system
from .document import write_section
from .picture import curve_picture
from .results import Evaluation, Row, Word, mean_of
from .settings import IN_SAMPLE_SCENES, MARKS, PromptKind, methods_of
from .summary import n_ranked_first, summarise

T = TypeVar("T")

_MEASURES = "IoU | BIoU | halo | stray | holes | Gaussians | PSNR dB | CPU s | wall s"
_RIGHT = " | ".join(["---:"] * 9)
_PROMPTS: dict[PromptKind, str] = {
    "mask": (
        "The prompt for every object is its true mask in one photo, which is not compared for that object: the one "
        "that shows it largest and whole, among those not compared if any shows it."
    ),
    "click": (
        "The prompt for every object is a click in the middle of its true mask in one photo, which is not compared for "
        "that object: the one that shows it largest and whole, among those not compared if any shows it."
    ),
    "text": (
        "The prompt for every object is its text. For a word the first result counts. For equal objects, which share a "
        "text, as many results as there are objects count in the table of objects, each for the object that it matches "
        "best."
    ),
    "all": (
        "All objects are searched for without a prompt. Each result counts for one object at most, so that the sum of "
        "their IoU is largest."
    ),
}
_PROMPTED_BY: dict[PromptKind, str] = {
    "mask": "prompted by true masks",
    "click": "prompted by clicks",
    "text": "prompted by texts",
    "all": "all objects without a prompt",
}

INTRODUCTION = """# Segmentation of objects

The command above each table writes the whole section. Each section says whether it is in sample or a test."""

MEANINGS = """## What the columns mean

- In sample: constants of the method were chosen on this scene, so its figures are better than those to expect
  elsewhere. Test: none was. Compared photos are those that training did not see, and isolating an object looks at none
  of the photos that it is compared in, unless the section says otherwise. Where cameras are estimated, all photos take
  part in that.
- found: objects, or words, with a mean IoU of at least 50 % over the compared photos. **Bold**: not found.
- IoU, BIoU: as in the script of Gaussian Grouping, in percent; means over the views of an object, then over all
  objects. The boundary is the band inside of a mask with a width of 0.02 of the picture's diagonal. Objects for which
  nothing was returned count 0 (that script skips them). Rows of objects have IoU / BIoU.
- halo: predicted pixels outside of the true mask within that band's width; stray: those farther away; holes: missing
  pixels of the true mask. All in percent of the true mask's pixels.
- Gaussians: IoU with the Gaussians of the object, determined from the true masks of all photos, in percent. Empty where
  the masks do not label every pixel.
- PSNR: between the object rendered alone on black and the photo, within the true mask.
- CPU s, wall s: from the prompt to the Gaussians. All views are rendered for each object. SAM's embeddings of the
  photos that the masks stage segmented are stored, as in a project. Loading a model counts for the first object that
  needs it, and describing the groups of the scene for the first text. The median and the worst are those of the prompts
  after the first.
- Rows of words: the object with which the first result has the highest IoU, if that is at least 50 %; then the IoU of
  the first result with the object that the word names (of equal objects the one that it matches best), 0 for a refused
  word. In brackets the score of the best candidate of a refused word. An absent word should be refused.
- Words ranked first on the true masks: the objects are cut out of photos that may be looked at by their true masks,
  as candidates of a text are by their own, and the detector scores each of them with all words of the scene and for
  absent things. The word of an object counts when no other word has a higher score. This is what the detector makes of
  perfect outlines.
- Results of a search for all objects: "ignored" are those of which most pixels show furniture and other things that the
  true masks ignore; they are neither right nor wrong. "unseen" are those that no compared photo shows. "false" are all
  others with an IoU below 50 %.
- Every figure of every object and word is in the file that `--results` writes."""


def data_of(evaluation: Evaluation, title: str) -> Literal["in sample", "test"]:
    """Return whether constants of the method were chosen on the scene of an evaluation, by its name.

    Parameters
    ----------
    title : str
        Name of the scene in the table, which may differ from the name of its folder.
    """
    return "in sample" if {evaluation.scene, title} & set(IN_SAMPLE_SCENES) else "test"


def markdown(evaluation: Evaluation) -> str:
    """Return the tables and remarks: figures of every method, then a row for every object or word."""
    kind = evaluation.settings.prompt_kind
    blocks = [_means(evaluation)]
    if kind == "text":
        blocks = [_word_figures(evaluation), _ceiling(evaluation), _words(evaluation), *blocks]
    elif kind == "all":
        blocks = [_search_figures(evaluation), *blocks, _results(evaluation)]
    else:
        blocks.append(_objects(evaluation))
    return "\n\n".join([*blocks, *(["\n".join(remarks)] if (remarks := list(_remarks(evaluation))) else [])])


def write_evaluation(path: Path, evaluation: Evaluation, *, title: str, command: str) -> None:
    """Write one section of a Markdown file and its plot beside it; other sections stay unchanged.

    Parameters
    ----------
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
    kind = evaluation.settings.prompt_kind
    parts = [f"```\n{command}\n```", MARKS[data_of(evaluation, title)], markdown(evaluation)]
    if kind != "all":
        image = path.with_name(f"{path.stem}_{re.sub('[^0-9A-Za-z_-]+', '-', title)}_{kind}.png")
        write_file(image, curve_picture(evaluation))
        parts.append(f"![IoU against CPU seconds]({image.name})")
    parts.append(_conditions(evaluation))
    parts.append(f"Gaussian Heritage {__version__}, {machine.cores} cores, {describe_system()}.")
    heading = f"{title}, {_PROMPTED_BY[kind]}"
    write_section(path, introduction=INTRODUCTION, title=heading, body="\n\n".join(parts), closing=MEANINGS)


def _conditions(evaluation: Evaluation) -> str:
    photos, trained = evaluation.photos, evaluation.n_trained_on
    seen = f"training saw {trained} of them" if trained else "training saw none of them"
    compared = set(photos) & set(evaluation.looked_at)
    looked_at = (
        f"Isolating looked at all of them and at {len(evaluation.looked_at) - len(photos)} other photos."
        if compared
        else f"Isolating looked at none of them, but at the {len(evaluation.looked_at)} other photos."
    )
    stages = ", ".join(f"{stage} {wall:.0f} s ({cpu:.0f})" for stage, wall, cpu in evaluation.stages)
    return (
        f"{evaluation.n_gaussians:,} Gaussians; {len(photos)} photos with true masks ({evaluation.layout}) are "
        f"compared; {seen}: {', '.join(photos)}. {looked_at} {_PROMPTS[evaluation.settings.prompt_kind]} A predicted "
        "mask holds the pixels of the photo of which the object makes up more than half, with the rest of the scene in "
        "front of it." + (f" Stages before the first prompt, in wall (CPU) seconds: {stages}." if stages else "")
    )


def _means(evaluation: Evaluation) -> str:
    objects = list(dict.fromkeys(row.object for row in evaluation.rows))
    lines = [f"| mean of {len(objects)} objects | found | {_MEASURES} |", f"| --- | ---: | {_RIGHT} |"]
    for method in methods_of(evaluation.settings):
        rows = [row for row in evaluation.rows if row.method == method.name]
        lines.append(f"| {method.name} | {sum(row.found for row in rows)} of {len(rows)} | {_cells(rows)} |")
    return "\n".join(lines)


def _objects(evaluation: Evaluation) -> str:
    """Return a row for each object, with its IoU and boundary IoU by each preset."""
    presets = [name for name in evaluation.settings.presets if any(row.method == name for row in evaluation.rows)]
    lines = [f"| object | views | {' | '.join(presets)} |", f"| --- | ---: |{' ---: |' * len(presets)}"]
    for name, rows in _by(evaluation.rows, lambda row: row.object).items():
        by_method = {row.method: row for row in rows}
        cells = [_object_cell(by_method[preset]) for preset in presets]
        lines.append(f"| {_cell(name)} | {rows[0].n_views} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _object_cell(row: Row) -> str:
    ious = f"{_number(100 * row.iou)} / {_number(100 * row.boundary_iou)}"
    return ious if row.found else f"**{ious}**"


def _word_figures(evaluation: Evaluation) -> str:
    lines = [
        "| method | words found | IoU | BIoU | absent words refused | CPU s, median | worst | wall s, median | worst |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for figures in summarise(evaluation):
        refused = f"{figures.n_refused} of {figures.n_absent}" if figures.n_absent else "-"
        seconds = (
            figures.cpu_seconds_median, figures.cpu_seconds_worst, figures.seconds_median, figures.seconds_worst
        )  # fmt: skip
        cells = [_number(100 * figures.iou), _number(100 * figures.boundary_iou), refused, *map(_number, seconds)]
        lines.append(f"| {figures.method} | {figures.n_found} of {figures.n_asked} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _ceiling(evaluation: Evaluation) -> str:
    ceiling = evaluation.ceiling
    if ceiling is None:
        return "Words ranked first on the true masks: not measured, since no photo with true masks may be looked at."
    others = ", ".join(f"{word} ({first or 'nothing'})" for word, first in ceiling.items() if word != first)
    return f"Words ranked first on the true masks: {n_ranked_first(evaluation)} of {len(ceiling)}" + (
        f"; not: {others}, with the word that is first." if others else "."
    )


def _words(evaluation: Evaluation) -> str:
    """Return a row for each word of an object, and what was answered to the absent words."""
    words = [word for word in evaluation.words if word.method in evaluation.settings.presets]
    presets = list(dict.fromkeys(word.method for word in words))
    lines = [f"| word | {' | '.join(presets)} |", f"| --- |{' --- |' * len(presets)}"]
    for prompt, asked in _by([word for word in words if not word.absent], lambda word: word.prompt).items():
        lines.append(f"| {_cell(prompt)} | {' | '.join(map(_word_cell, asked))} |")
    refused = {preset: [word for word in words if word.method == preset and not word.absent and not word.n_results]
               for preset in presets}  # fmt: skip
    if any(refused.values()):
        counts = (f"{preset} {sum(word.is_offered for word in asked)} of {len(asked)}"
                  for preset, asked in refused.items() if asked)  # fmt: skip
        lines += ["", f"Refused words whose object is among the pictures that are offered: {', '.join(counts)}."]
    absent = [word for word in words if word.absent]
    if absent:
        names = dict.fromkeys(_cell(word.prompt) for word in absent)
        lines += ["", f"Absent words: {', '.join(names)}.", ""]
        lines += ["| method | absent words that it answered, with the object shown |", "| --- | --- |"]
        for preset in presets:
            shown = [
                f"{_cell(word.prompt)} ({_cell(word.shows or 'no object')})"
                for word in absent
                if word.method == preset and word.n_results
            ]
            lines.append(f"| {preset} | {', '.join(shown) or 'none'} |")
    return "\n".join(lines)


def _word_cell(word: Word) -> str:
    if word.n_results:
        text = f"{_cell(word.shows or 'no object')} {_number(100 * word.iou)}"
    else:
        text = "refused" if math.isnan(word.score) else f"refused ({word.score:.2f})"
    return text if word.found else f"**{text}**"


def _search_figures(evaluation: Evaluation) -> str:
    lines = [
        "| method | found | IoU | BIoU | results | ignored | unseen | false | CPU s | wall s |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for figures in summarise(evaluation):
        counts = (figures.n_results, figures.n_ignored, figures.n_unseen, figures.n_false)
        cells = [_number(100 * figures.iou), _number(100 * figures.boundary_iou), *map(str, counts)]
        cells += [_number(figures.cpu_seconds_median), _number(figures.seconds_median)]
        lines.append(f"| {figures.method} | {figures.n_found} of {figures.n_asked} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _results(evaluation: Evaluation) -> str:
    """Return a row for each object with the result that counts for it, and the results that count for none."""
    results = [result for search in evaluation.searches for result in search.results]
    lines = ["| object | views | IoU / BIoU | suggested name | score |", "| --- | ---: | ---: | --- | ---: |"]
    for row in evaluation.rows:
        result = next((one for one in results if one.object == row.object), None)
        name, score = (_cell(result.name or "-"), f"{result.score:.2f}") if result else ("-", "-")
        lines.append(f"| {_cell(row.object)} | {row.n_views} | {_object_cell(row)} | {name} | {score} |")
    others = [f"{_cell(one.name or '-')} {one.score:.2f} ({one.kind})" for one in results if not one.object]
    return "\n".join(
        [*lines, "", f"Results for no object, by suggested name and score: {', '.join(others) or 'none'}."]
    )


def _by(ones: Iterable[T], key: Callable[[T], str]) -> dict[str, list[T]]:
    """Return what has the same key together, in the order of the first of each."""
    groups: dict[str, list[T]] = {}
    for one in ones:
        groups.setdefault(key(one), []).append(one)
    return groups


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
    presets, kind = evaluation.settings.presets, evaluation.settings.prompt_kind
    if kind == "text":  # a word that was refused by its score has the score in its row
        refused = [word for word in evaluation.words if word.method in presets and not word.absent]
        yield from (f"- {one.prompt}, {one.method}: {one.remark}" for one in refused if math.isnan(one.score))
    elif kind != "all":
        yield from (f"- {row.object}, {row.method}: {row.remark}" for row in evaluation.rows if row.remark)
    for name in evaluation.left_out:
        yield f"- {name}: left out, since no photo is left to compare it in."
    if evaluation.unplaced:
        yield f"- Left out, since no camera is known: {', '.join(evaluation.unplaced)}."
