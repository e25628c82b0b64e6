"""The stored result of one room with one method: a small JSON file, and the figures that the table shows of it."""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from engine.core.errors import FormatError
from engine.core.files import optional, read_json, write_json
from engine.quality.evaluation.results import FOUND_IOU, WHOLE_IOU

from .draws import RESULTS

METHODS = ("paper", "released", "better")
"""Presets of `engine.objects.settings` that are measured."""
SHORT = 12
"""Digits of a commit in the names of folders."""
VERSION = 1

_OBJECT = {"object": str, "iou": float, "boundary_iou": float}
_WORD = {"word": str, "refused": bool, "wall": float, "cpu": float}
_SECONDS = {"wall": float, "cpu": float, "whole": bool}
_MEASURED = {
    "version": int,
    "machine": {"cores": int, "system": str},
    "n_gaussians": int,
    "test_photos": [str],
    "test_psnr": (float, None),
    "seconds": {str: _SECONDS},
    "mask": {str: [_OBJECT]},
    "click": optional({str: [_OBJECT]}),
    "text": {str: {"words": [{"iou": float, **_WORD}], "absent": [_WORD]}},
    "ceiling": ({str: str}, None),
    "all": {str: {"objects": [_OBJECT], "n_false": int, "n_results": int, "wall": float, "cpu": float}},
}
"""What `benchmarks.rooms measure` writes, in the working tree of the frozen method; the first methods had no clicks."""
_RESULT = {**_MEASURED, "room": str, "seed": int, "commit": str, "pictures": str, "rendered": optional(_SECONDS)}


def result_file(repository: Path, commit: str, room: str) -> Path:
    """Return the file with the result of a room with the method that `commit` froze."""
    return repository / RESULTS / commit[:SHORT] / f"{room}.json"


def read_measured(path: Path) -> dict[str, Any]:
    """Return what ``measure`` wrote.

    Raises
    ------
    FormatError
        When the file cannot be read, or another version wrote it.
    """
    return _read(path, _MEASURED)


def read_result(repository: Path, commit: str, room: str) -> dict[str, Any] | None:
    """Return the result of a room, None when it is not measured yet.

    Raises
    ------
    FormatError
        When the file cannot be read, or is the result of another room or method.
    """
    path = result_file(repository, commit, room)
    if not path.exists():
        return None
    result = _read(path, _RESULT)
    if (result["room"], result["commit"]) != (room, commit):
        raise FormatError(
            f"{path} holds the result of {result['room']} with the commit {result['commit'][:SHORT]}. Delete it, then "
            "run `make test-rooms` again."
        )
    return result


def write_result(repository: Path, result: dict[str, Any]) -> None:
    """Write a result atomically.

    Raises
    ------
    DiskError
        When it cannot be written.
    """
    write_json(result_file(repository, result["commit"], result["room"]), result)


def _read(path: Path, schema: dict[str, Any]) -> dict[str, Any]:
    advice = "Restore it with git, or delete it and run `make test-rooms` again."
    data: dict[str, Any] = read_json(path, schema, advice=advice)
    if data["version"] != VERSION:
        raise FormatError(f"{path} cannot be read: there is no version {data['version']}. {advice}")
    return data


@dataclass(frozen=True)
class Figures:
    """Figures of one room with one method; shares in percent, None where nothing could be measured.

    Attributes
    ----------
    n_objects, n_words, n_absent : int
    iou, boundary_iou : float or None
        By mask, means over the objects.
    whole : float or None
        By mask, objects with an IoU of at least `WHOLE_IOU`.
    click_found, click_whole, click_iou, click_boundary_iou : float or None
        By click: objects with an IoU of at least `FOUND_IOU`, of at least `WHOLE_IOU`, and means over the objects.
    words_found, words_whole : float or None
        Words whose object has an IoU of at least `FOUND_IOU`, and of at least `WHOLE_IOU`.
    word_iou : float or None
        Mean over all words; 0 for a refused one.
    refused : float or None
        Words for absent things that found nothing.
    ceiling : float or None
        Words that the detector ranks first on the true mask's crop.
    word_seconds, worst_seconds : float or None
        Median and maximum over all words but the first, which loads the models; wall seconds.
    all_found, all_whole, all_iou : float or None
        Find all: objects with a result of an IoU of at least `FOUND_IOU`, of at least `WHOLE_IOU`, and mean IoU over
        all objects.
    false_finds : float or None
        Number of results of find all that are no object.
    psnr : float or None
        On the test photos, dB.
    minutes : float or None
        From the seed to the result, wall time; None when a part was not measured whole.
    """

    n_objects: int
    n_words: int
    n_absent: int
    iou: float | None
    boundary_iou: float | None
    whole: float | None
    click_found: float | None
    click_whole: float | None
    click_iou: float | None
    click_boundary_iou: float | None
    words_found: float | None
    words_whole: float | None
    word_iou: float | None
    refused: float | None
    ceiling: float | None
    word_seconds: float | None
    worst_seconds: float | None
    all_found: float | None
    all_whole: float | None
    all_iou: float | None
    false_finds: float | None
    psnr: float | None
    minutes: float | None


def figures_of(result: dict[str, Any], method: str) -> Figures | None:
    """Return the figures of a method, None when the result does not have it.

    Without ``find all``, which not every preset can do, its figures are None, and so are those of clicks where they
    were not measured.
    """
    if method not in result["mask"] or method not in result["text"]:
        return None
    masks, words = result["mask"][method], result["text"][method]["words"]
    absent, found = result["text"][method]["absent"], result["all"].get(method)
    clicks = result.get("click", {}).get(method, [])
    # The first word loads the models.
    seconds = [one["wall"] for one in (*words, *absent)][1:]
    ceiling = result["ceiling"]
    return Figures(
        n_objects=len(masks),
        n_words=len(words),
        n_absent=len(absent),
        iou=_percent(one["iou"] for one in masks),
        boundary_iou=_percent(one["boundary_iou"] for one in masks),
        whole=_percent(one["iou"] >= WHOLE_IOU for one in masks),
        click_found=_percent(one["iou"] >= FOUND_IOU for one in clicks),
        click_whole=_percent(one["iou"] >= WHOLE_IOU for one in clicks),
        click_iou=_percent(one["iou"] for one in clicks),
        click_boundary_iou=_percent(one["boundary_iou"] for one in clicks),
        words_found=_percent(one["iou"] >= FOUND_IOU for one in words),
        words_whole=_percent(one["iou"] >= WHOLE_IOU for one in words),
        word_iou=_percent(one["iou"] for one in words),
        refused=_percent(one["refused"] for one in absent),
        ceiling=None if ceiling is None else _percent(word == first for word, first in ceiling.items()),
        word_seconds=statistics.median(seconds) if seconds else None,
        worst_seconds=max(seconds, default=None),
        all_found=None if found is None else _percent(one["iou"] >= FOUND_IOU for one in found["objects"]),
        all_whole=None if found is None else _percent(one["iou"] >= WHOLE_IOU for one in found["objects"]),
        all_iou=None if found is None else _percent(one["iou"] for one in found["objects"]),
        false_finds=None if found is None else float(found["n_false"]),
        psnr=result["test_psnr"],
        minutes=_minutes(result),
    )


def _percent(values: Iterable[float]) -> float | None:
    numbers = [float(value) for value in values]
    return 100 * statistics.fmean(numbers) if numbers else None


def _minutes(result: dict[str, Any]) -> float | None:
    """Return the minutes from the seed to the result, None when a part was not measured whole."""
    parts = [result.get("rendered"), *result["seconds"].values()]
    if any(part is None or not part["whole"] for part in parts):
        return None
    return sum(part["wall"] for part in parts) / 60
