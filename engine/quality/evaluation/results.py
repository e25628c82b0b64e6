"""Results of an evaluation: one row per object, word, or result of a search for all objects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .settings import EvaluationSettings, Layout

FOUND_IOU = 0.5
"""Mean IoU over the compared photos from which on an object, or a word, counts as found."""
WHOLE_IOU = 0.85
"""Mean IoU from which on a curator would call an object whole."""

ResultKind = Literal["object", "ignored", "unseen", "false"]


@dataclass(frozen=True)
class Row:
    """One object, isolated with one method. Shares are 0 to 1, means over the views; NaN where nothing was measured.

    Attributes
    ----------
    object : str
    method : str
    returned : bool
        Whether the method returned anything for the object. If not, `iou` and `boundary_iou` are 0 and `holes` is 1.
    iou, boundary_iou, halo, stray, holes : float
        See `engine.masks.mask_metrics`.
    psnr : float
        PSNR in dB between the object rendered alone on black and the photo, within the true mask.
    gaussian_iou : float
        See `engine.quality.evaluation.gaussian_truth`.
    seconds, cpu_seconds : float
        Time from the prompt to the Gaussians; NaN if no prompt asked for this object alone.
    n_views : int
    prompt_photo : str
        Photo of the true mask or the click; empty without one.
    remark : str
        Reason why nothing was returned.
    """

    object: str
    method: str
    returned: bool
    iou: float
    boundary_iou: float
    halo: float
    stray: float
    holes: float
    psnr: float
    gaussian_iou: float
    seconds: float
    cpu_seconds: float
    n_views: int
    prompt_photo: str
    remark: str = ""

    @property
    def found(self) -> bool:
        """Whether `iou` is at least `FOUND_IOU`."""
        return self.iou >= FOUND_IOU


@dataclass(frozen=True)
class Word:
    """One word, asked for with one method.

    Attributes
    ----------
    prompt : str
    method : str
    absent : bool
        Whether the scene shows nothing that the word names.
    n_results : int
        0 if the word was refused.
    score : float
        Of the first result; if the word was refused, of the best candidate; NaN without one.
    iou, boundary_iou : float
        Of the first result with the object that the word names (of equal objects the one that it matches best), means
        over the compared photos that show the object; 0 for a refused word, NaN for an absent one.
    shows : str
        Object whose mean IoU with the first result is highest, if it is at least `FOUND_IOU`; else empty.
    seconds, cpu_seconds : float
    remark : str
        Reason why the word was refused.
    offered_iou : float
        Of a refused word, the highest mean IoU of what was offered as pictures with an object that the word names; NaN
        for an absent word and one that was not refused.
    """

    prompt: str
    method: str
    absent: bool
    n_results: int
    score: float
    iou: float
    boundary_iou: float
    shows: str
    seconds: float
    cpu_seconds: float
    remark: str = ""
    offered_iou: float = float("nan")

    @property
    def found(self) -> bool:
        """Whether `iou` is at least `FOUND_IOU`."""
        return self.iou >= FOUND_IOU

    @property
    def is_offered(self) -> bool:
        """Whether the word was refused and its object is among the pictures that it was answered with."""
        return self.offered_iou >= FOUND_IOU


@dataclass(frozen=True)
class Result:
    """One result of a search for all objects.

    Attributes
    ----------
    name : str
        Suggested by the detector; may be empty.
    score : float
        Of the name, 0 to 1.
    object : str
        Object that the result counts for; empty for none. Each result counts for one object at most.
    iou : float
        Mean IoU with that object over the compared photos that show it; 0 for none.
    kind : {"object", "ignored", "unseen", "false"}
        ``object``: `iou` is at least `FOUND_IOU`. ``ignored``: most of its pixels in the compared photos show things
        that the ground truth ignores. ``unseen``: no compared photo shows it. ``false``: neither.
    """

    name: str
    score: float
    object: str
    iou: float
    kind: ResultKind


@dataclass(frozen=True)
class Search:
    """One search for all objects.

    Attributes
    ----------
    method : str
    results : tuple of Result
    seconds, cpu_seconds : float
    """

    method: str
    results: tuple[Result, ...]
    seconds: float
    cpu_seconds: float


@dataclass(frozen=True)
class Evaluation:
    """Results of an evaluation, and the data that they were measured on.

    Attributes
    ----------
    rows : tuple of Row
    words : tuple of Word
        With ``prompt_kind="text"``, in the order in which they were asked for.
    searches : tuple of Search
        With ``prompt_kind="all"``.
    ceiling : mapping of str to str, or None
        With ``prompt_kind="text"``: for each word the word that the detector scores highest on the true mask of its
        object, see `engine.quality.evaluation.ceiling`. None where no photo is left to measure it in.
    settings : EvaluationSettings
    scene : str
        Name of the folder with the ground truth, or of the folder around it if it is called ``truth``.
    layout : str
        Layout of the true masks.
    photos : tuple of str
        Compared photos.
    looked_at : tuple of str
        Photos that isolating could look at, besides the photo of a prompt.
    n_trained_on : int
        Number of `photos` that training saw.
    unplaced : tuple of str
        Views with true masks that were left out, since they have no camera.
    left_out : tuple of str
        Objects that were left out, since no photo is left to compare them in.
    n_gaussians : int
    stages : tuple of (str, float, float)
        Stage, wall seconds and CPU seconds of the run that made the project.
    """

    rows: tuple[Row, ...]
    words: tuple[Word, ...]
    searches: tuple[Search, ...]
    ceiling: Mapping[str, str] | None
    settings: EvaluationSettings
    scene: str
    layout: Layout
    photos: tuple[str, ...]
    looked_at: tuple[str, ...]
    n_trained_on: int
    unplaced: tuple[str, ...]
    left_out: tuple[str, ...]
    n_gaussians: int
    stages: tuple[tuple[str, float, float], ...]


def mean_of(values: Iterable[float]) -> float:
    """Return the mean of the values that are not NaN; NaN when there are none."""
    numbers = [value for value in values if not np.isnan(value)]
    return float(np.mean(numbers)) if numbers else float("nan")
