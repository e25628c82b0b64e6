"""Words on true outlines: what a detector makes of perfect sets, without a trained scene."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Float32, Float64, Mask
from ...core.errors import Cancelled, PromptError, SettingsError
from ...core.events import Emit, Progress, StopCheck
from ...core.system import cpu_seconds
from ...masks import mask_box
from ...objects import Looks
from ...objects.settings import BETTER
from ...photos import load_pixels, picture_files
from .comparison import resized
from .ground_truth import GroundTruth, read_ground_truth

if TYPE_CHECKING:
    from ...objects.grounding import Detector

_MIN_AREA = 0.25
"""Smallest area of a thing in a photo, as a share of that in the photo which shows most of it."""


@dataclass(frozen=True)
class WordRule:
    """Answers by the least score of a room (`Looks.least_odds`).

    Attributes
    ----------
    found : int
        Words whose likeliest thing is one that they name, and is accepted.
    refused : int
        Absent words of which nothing is accepted.
    answered : tuple of str
        The other absent words.
    """

    found: int
    refused: int
    answered: tuple[str, ...]


@dataclass(frozen=True)
class OutlineFigures:
    """Words of a detector on the true outlines of a room.

    Attributes
    ----------
    room, detector : str
    n_things : int
        Outlined things, furniture among them.
    n_crops : int
        Photos of them that were described.
    n_words, n_absent : int
        Words asked for, and words for absent things; unknown ones among them.
    n_first : int
        Words that no other word of the room beats on one of their things.
    rule : WordRule
    describing, asking : float
        CPU seconds for all crops, and for a word after.
    """

    room: str
    detector: str
    n_things: int
    n_crops: int
    n_words: int
    n_absent: int
    n_first: int
    rule: WordRule
    describing: float
    asking: float


def evaluate_outlines(
    room: Path, detectors: Sequence[tuple[str, Callable[[], Detector]]], emit: Emit, should_stop: StopCheck
) -> list[OutlineFigures]:
    """Return the figures of detectors on a room.

    Parameters
    ----------
    room : Path
        Folder with ``photos`` and their true masks in ``truth`` (layout ``museum``).
    detectors : sequence of (str, callable)
        Names, and what returns each.
    emit, should_stop
        As everywhere.

    Raises
    ------
    SettingsError
        When a detector describes no crops.
    FormatError, MaskError, PhotoError
        When a file is missing or cannot be read.
    Cancelled
        When `should_stop` returns True.
    """
    photos = [file.name for file in picture_files(room / "photos")]
    truth = read_ground_truth(room / "truth", photos, layout="museum")
    found = []
    for number, (name, load) in enumerate(detectors):
        emit(Progress("words", number / len(detectors), message=f"{name} in {room.name}"))
        found.append(_figures(room, truth, load(), should_stop))
    return found


def _figures(room: Path, truth: GroundTruth, detector: Detector, should_stop: StopCheck) -> OutlineFigures:
    started = cpu_seconds()
    things, looks = _outlined(room, truth, detector, should_stop)
    described = cpu_seconds()
    named = {word: [things.index(one) for one in truth.objects if one in things and truth.prompts[one] == word]
             for word in dict.fromkeys(truth.prompts.values())}  # fmt: skip
    named = {word: numbers for word, numbers in named.items() if numbers}
    odds = {word: _odds(looks, word, detector, should_stop) for word in [*named, *truth.absent]}
    least = looks.least_odds(detector)
    asked = cpu_seconds()
    firsts = np.argmax(np.stack([_scores(looks, word, detector) for word in odds]), axis=0)
    words = list(odds)
    return OutlineFigures(
        room.name, detector.name, len(things), len(looks.proposal), len(named), len(truth.absent),
        sum(any(words[firsts[number]] == word for number in numbers) for word, numbers in named.items()),
        _answers(least, odds, named, truth.absent),
        described - started, (asked - described) / max(1, len(odds)),
    )  # fmt: skip


def _answers(least: float, odds: dict[str, Float64], named: dict[str, list[int]], absent: Sequence[str]) -> WordRule:
    found = sum(float(odds[word].max()) > least and int(odds[word].argmax()) in named[word] for word in named)
    answered = tuple(word for word in absent if float(odds[word].max()) > least)
    return WordRule(found, len(absent) - len(answered), answered)


def _odds(looks: Looks, word: str, detector: Detector, should_stop: StopCheck) -> Float64:
    """Return the log-odds of each thing; minus infinity for a word that the detector does not know."""
    if should_stop():
        raise Cancelled("Stopped while words were scored; nothing was written.")
    try:
        return looks.odds_of(word, detector)
    except PromptError:
        return np.full(len(looks.like), -np.inf)


def _scores(looks: Looks, word: str, detector: Detector) -> Float64:
    """Return the mean score of each thing; 0 for a word that the detector does not know."""
    try:
        scores = detector.score_descriptions(looks.described, word)
    except PromptError:
        return np.zeros(len(looks.like))
    counts = np.bincount(looks.proposal, minlength=len(looks.like))
    return np.bincount(looks.proposal, scores, minlength=len(looks.like)) / np.maximum(counts, 1)


def _outlined(room: Path, truth: GroundTruth, detector: Detector, should_stop: StopCheck) -> tuple[list[str], Looks]:
    """Return the things of a room, and how the detector describes their true outlines."""
    areas: dict[str, dict[str, float]] = defaultdict(dict)
    for photo in truth.photos:
        for name, mask in {**truth.masks(photo), **truth.ignored_masks(photo)}.items():
            areas[name][photo] = float(mask.mean())
    things = [name for name in (*truth.objects, *truth.ignored) if areas[name]]
    wanted: dict[str, list[int]] = defaultdict(list)
    for number, name in enumerate(things):
        large = [photo for photo, area in areas[name].items() if area >= _MIN_AREA * max(areas[name].values())]
        for place in dict.fromkeys(np.linspace(0, len(large) - 1, BETTER.n_crop_views).round().astype(int).tolist()):
            wanted[large[place]].append(number)
    rows: list[Float32] = []
    proposals, photos, boxes = [], [], []
    for photo, numbers in wanted.items():
        if should_stop():
            raise Cancelled("Stopped while true outlines were described; nothing was written.")
        pixels = load_pixels(room / "photos" / photo, max_side=BETTER.photo_side)
        masks: list[Mask] = []
        all_masks = {**truth.masks(photo), **truth.ignored_masks(photo)}
        for number in numbers:
            mask = resized(all_masks[things[number]], pixels.shape[:2], photo)
            box = mask_box(mask)
            if box is not None:
                masks.append(mask)
                proposals.append(number)
                photos.append(photo)
                boxes.append(box)
        described = detector.describe_crops(pixels, boxes[len(boxes) - len(masks) :], masks) if masks else None
        if masks and described is None:
            raise SettingsError(f"{detector.name} describes no crops. Use `evaluate --prompt-kind text` to measure it.")
        if described is not None:
            rows.append(described)
    described = np.concatenate(rows).astype(np.float16).astype(np.float32)  # as those of a project are kept
    proposal = np.array(proposals, np.int32)
    whole = np.bincount(proposal, detector.whole_odds(described), minlength=len(things))
    odds = (whole / np.maximum(np.bincount(proposal, minlength=len(things)), 1)).astype(np.float32)
    return things, Looks(
        np.eye(len(things), dtype=bool), odds, np.arange(len(things), dtype=np.int32), proposal, tuple(photos),
        np.array(boxes, np.float32).reshape(-1, 2, 2), described,
    )  # fmt: skip


def outline_table(figures: Sequence[OutlineFigures]) -> str:
    """Return the figures as a table in Markdown, with the sums over rooms."""
    lines = [
        "| model | room | ranked first | found | absent refused | CPU s, crops | CPU s, word |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    sums: dict[str, Counter[str]] = defaultdict(Counter)
    for one in figures:
        lines.append(
            f"| {one.detector} | {one.room} | {one.n_first} of {one.n_words} | {one.rule.found} of {one.n_words} | "
            f"{one.rule.refused} of {one.n_absent} | {one.describing:.1f} | {one.asking:.2f} |"
        )
        sums[one.detector].update(
            first=one.n_first, words=one.n_words, found=one.rule.found, refused=one.rule.refused, absent=one.n_absent
        )
    for detector, total in sums.items():
        lines.append(
            f"| **{detector}** | **all** | {total['first']} of {total['words']} | {total['found']} of "
            f"{total['words']} | {total['refused']} of {total['absent']} | | |"
        )
    answered = (f"{one.detector}, {one.room}: {', '.join(one.rule.answered)}" for one in figures if one.rule.answered)
    return "\n".join([*lines, *(f"\nAbsent words that were answered: {text}." for text in answered)])
