"""Figures of each method of an evaluation: what was found, what was refused, and the time of a prompt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .results import Evaluation, Row, Search, Word, mean_of
from .settings import methods_of


@dataclass(frozen=True)
class Summary:
    """Figures of one method. Shares are 0 to 1; figures that this kind of prompt does not have are NaN or 0.

    Attributes
    ----------
    method : str
    n_asked : int
        Objects; with ``prompt_kind="text"``, words for objects that the scene shows.
    n_found : int
        Those with a mean IoU of at least `FOUND_IOU`.
    iou, boundary_iou : float
        Means over all of `n_asked`, with 0 where nothing was returned.
    n_absent, n_refused : int
        Words for absent things, and those of them that were refused.
    n_results, n_false, n_ignored, n_unseen : int
        Results of a search for all objects, and those of each kind, see `Result`.
    cpu_seconds_median, cpu_seconds_worst, seconds_median, seconds_worst : float
        CPU seconds and wall seconds of a prompt after the first, which loads the models. Of a search for all objects,
        its own.
    """

    method: str
    n_asked: int
    n_found: int
    iou: float
    boundary_iou: float
    n_absent: int
    n_refused: int
    n_results: int
    n_false: int
    n_ignored: int
    n_unseen: int
    cpu_seconds_median: float
    cpu_seconds_worst: float
    seconds_median: float
    seconds_worst: float


def summarise(evaluation: Evaluation) -> list[Summary]:
    """Return the figures of each method, in the order of `methods_of`."""
    return [_summary(evaluation, method.name) for method in methods_of(evaluation.settings)]


def n_ranked_first(evaluation: Evaluation) -> int | None:
    """Return how many words the detector scores highest on the true masks of their own objects; None if unknown."""
    if evaluation.ceiling is None:
        return None
    return sum(word == first for word, first in evaluation.ceiling.items())


def _summary(evaluation: Evaluation, method: str) -> Summary:
    rows = [row for row in evaluation.rows if row.method == method]
    words = [word for word in evaluation.words if word.method == method]
    present, absent = [word for word in words if not word.absent], [word for word in words if word.absent]
    searches = [search for search in evaluation.searches if search.method == method]
    kinds = [result.kind for search in searches for result in search.results]
    asked: Sequence[Row | Word] = present or rows
    timed: Sequence[Row | Word | Search] = searches or (words or rows)[1:]
    cpu_seconds, seconds = [one.cpu_seconds for one in timed], [one.seconds for one in timed]
    return Summary(
        method=method,
        n_asked=len(asked),
        n_found=sum(one.found for one in asked),
        iou=mean_of([one.iou for one in asked]),
        boundary_iou=mean_of([one.boundary_iou for one in asked]),
        n_absent=len(absent),
        n_refused=sum(word.n_results == 0 for word in absent),
        n_results=len(kinds),
        n_false=kinds.count("false"),
        n_ignored=kinds.count("ignored"),
        n_unseen=kinds.count("unseen"),
        cpu_seconds_median=_median(cpu_seconds),
        cpu_seconds_worst=max(cpu_seconds, default=float("nan")),
        seconds_median=_median(seconds),
        seconds_worst=max(seconds, default=float("nan")),
    )


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")
