"""Grounding DINO through onnxruntime: any words, boxes with scores; with segments, the one that fits each box best."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ModelFileError
from ..models import locate, open_session
from .detector import Detection, PromptCheck
from .dino_inputs import Tokens, caption, load_tokenizer, picture, resized_size
from .settings import GroundingSettings

__all__ = ["Boxes", "GroundingDino", "best_segments", "read_answer"]

Pixels = NDArray[np.uint8]
Float32 = NDArray[np.float32]

_INPUTS = ("pixel_values", "pixel_mask", "input_ids", "token_type_ids", "attention_mask")
_OUTPUTS = ["logits", "pred_boxes"]
# A crop is that much larger than the box on each side. Chosen, not measured: no real weights could be run here.
_MARGIN = 0.2
# A box in a crop shows what the crop was made for when they overlap at least that much.
_SAME = 0.5
_KEPT_ANSWERS = 256
"""Answers (photo and prompt) that are kept: of 900 boxes 18 KB each, and their labels."""


class Session(Protocol):
    """The part of onnxruntime's session that is used."""

    def get_inputs(self) -> Sequence[Any]: ...

    def get_outputs(self) -> Sequence[Any]: ...

    def run(self, names: Sequence[str] | None, given: dict[str, Any]) -> Sequence[Any]: ...


@dataclass(frozen=True)
class Boxes:
    """The model's whole answer, one row a query.

    Attributes
    ----------
    corners : array of shape [n, 4], float32
        x0, y0, x1, y1 in photo pixels; may reach over the edge a little.
    scores : array of shape [n], float32
        Of the best token.
    labels : tuple of str
        Words of the prompt whose tokens scored above the text threshold.
    """

    corners: Float32
    scores: Float32
    labels: tuple[str, ...]


class GroundingDino:
    """A Grounding DINO export with the inputs and outputs of ``transformers``.

    Parameters
    ----------
    name : str
        ``"grounding-dino-tiny"`` or ``"grounding-dino-base"``, as in the catalogue.
    cache : Path or None
        See `models.catalogue.models_folder`.
    settings : GroundingSettings or None
        None takes the defaults.
    threads : int
        Worker threads, 2 by default.

    Raises
    ------
    ModelFileError
        When a file is missing, damaged or another model.

    References
    ----------
    Liu et al., "Grounding DINO: Marrying DINO with Grounded Pre-Training for Open-Set Object Detection", 2023.
    """

    def __init__(
        self,
        name: str = "grounding-dino-tiny",
        cache: Path | None = None,
        *,
        settings: GroundingSettings | None = None,
        threads: int = 2,
    ) -> None:
        model = locate(f"{name}-model", cache)
        self._open(name, open_session(model, threads=threads), locate("grounding-dino-tokenizer", cache), settings)

    @classmethod
    def from_session(
        cls, name: str, session: Session, tokenizer: Path, settings: GroundingSettings | None = None
    ) -> GroundingDino:
        """Return the detector on an export that is open already."""
        made = cls.__new__(cls)
        made._open(name, session, tokenizer, settings)
        return made

    def _open(self, name: str, session: Session, tokenizer: Path, settings: GroundingSettings | None) -> None:
        self.name = name
        self._settings = settings or GroundingSettings()
        self._session = session
        shapes = {given.name: list(given.shape) for given in session.get_inputs()}
        outputs = {given.name for given in session.get_outputs()}
        if not set(shapes) <= set(_INPUTS) or not {"pixel_values", "input_ids"} <= set(shapes):
            raise ModelFileError(f"{name} has the inputs {', '.join(shapes)}: it is not a Grounding DINO export.")
        if not set(_OUTPUTS) <= outputs:
            raise ModelFileError(f"{name} has the outputs {', '.join(outputs)}: it is not a Grounding DINO export.")
        self._inputs = list(shapes)
        # A fixed side is a number, a free one a name or None.
        height, width = shapes["pixel_values"][2:4]
        self._size = (height, width) if isinstance(height, int) and isinstance(width, int) else None
        length = shapes["input_ids"][1]
        self._length = length if isinstance(length, int) else None
        self._tokenizer = load_tokenizer(tokenizer)
        self._answers: OrderedDict[str, Boxes] = OrderedDict()

    def knows(self, prompt: str) -> PromptCheck:
        """Return that `prompt` can be looked for: any words can.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        caption(prompt)
        return PromptCheck(True, [], f"{self.name} looks for any words; it was trained on English ones.")

    def detect(self, pixels: Pixels, prompt: str, *, labels: NDArray[np.int32] | None = None) -> list[Detection]:
        """Return what was found, best first; see `Detector.detect`.

        Notes
        -----
        A box none of whose tokens scores above the text threshold is labelled with the prompt itself.
        With `labels` each box becomes the segment that fits it best (`best_segments`); boxes that none fits are
        dropped, and of several boxes on one segment the best stays.
        """
        answer = self.answer(pixels, prompt)
        order = [
            i for i in np.argsort(-answer.scores, kind="stable") if answer.scores[i] > self._settings.box_threshold
        ]
        kept = _without_doubles(answer.corners, order, self._settings.max_overlap)
        boxes = _inside(answer.corners[kept], pixels.shape)
        found = [
            Detection(_as_box(box), float(answer.scores[i]), answer.labels[i] or prompt.strip())
            for i, box in zip(kept, boxes, strict=True)
        ]
        if labels is None:
            return found
        if labels.shape != pixels.shape[:2]:
            labels = cv2.resize(labels, pixels.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        chosen: dict[int, Detection] = {}
        for one, (region, fit, box) in zip(found, best_segments(boxes, labels), strict=True):
            if region and fit >= self._settings.min_fit and region not in chosen:
                chosen[region] = Detection(box, one.score, one.label, region)
        return list(chosen.values())

    def score_crops(
        self,
        pixels: Pixels,
        boxes: ArrayLike,
        prompt: str,
        *,
        masks: Sequence[NDArray[np.bool_]] | None = None,
    ) -> list[float]:
        """Return how well each box, or the box around each mask, shows what `prompt` names, 0 to 1.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB
        boxes : array-like of shape [n, 4]
            x0, y0, x1, y1 in pixels.
        prompt : str
        masks : sequence of n bool arrays of shape [H, W], or None
            The object in each box; only its extent is used, since the model was trained on whole scenes, not on things
            cut out.

        Returns
        -------
        list of n float
            The best score of a box that overlaps the given one (IoU >= 0.5) when the model looks at the crop, a fifth
            larger than the box on each side; 0 where no box does. One run of the model a box.

        Raises
        ------
        PromptError
            When the prompt is empty or too long.
        """
        places = np.asarray(boxes, np.float64).reshape(-1, 4)
        if masks is not None:
            if len(masks) != len(places):
                raise ValueError(f"{len(places)} boxes and {len(masks)} masks")
            places = np.array([_extent(mask, box) for mask, box in zip(masks, places, strict=True)]).reshape(-1, 4)
        return [self._score_crop(pixels, box, prompt) for box in places]

    def describe_crops(self, pixels: Pixels, boxes: ArrayLike, masks: Sequence[NDArray[np.bool_]]) -> None:
        """Return None: this model must be told what to look for; see `Detector.describe_crops`."""
        return None

    def score_described(self, described: NDArray[np.float32], prompt: str) -> list[float]:
        """Never asked, since `describe_crops` gives nothing; see `Detector.score_described`."""
        raise NotImplementedError(f"{self.name} describes nothing")

    def name_crops(self, crops: Sequence[tuple[Pixels, ArrayLike, NDArray[np.bool_]]]) -> list[tuple[str, float]]:
        """Return nothing: this model looks for given words and has none of its own; see `Detector.name_crops`."""
        return []

    def _score_crop(self, pixels: Pixels, box: NDArray[np.float64], prompt: str) -> float:
        margin = _MARGIN * (box[2:] - box[:2])
        height, width = pixels.shape[:2]
        x0, y0 = np.clip(np.floor(box[:2] - margin), 0, (width - 1, height - 1)).astype(int)
        x1, y1 = np.clip(np.ceil(box[2:] + margin), (x0 + 1, y0 + 1), (width, height)).astype(int)
        answer = self.answer(np.ascontiguousarray(pixels[y0:y1, x0:x1]), prompt)
        overlaps = _ious(answer.corners, (box - (x0, y0, x0, y0)).astype(np.float32))
        return float(answer.scores[overlaps >= _SAME].max(initial=0.0))

    def answer(self, pixels: Pixels, prompt: str) -> Boxes:
        """Return all boxes of the model, also those below the threshold; kept for the same photo and prompt."""
        text = caption(prompt)
        key = sha256(np.ascontiguousarray(pixels).data)
        key.update(repr((pixels.shape, text)).encode())
        if key.hexdigest() not in self._answers:
            self._answers[key.hexdigest()] = self._run(pixels, self._tokenizer(text, self._length))
            if len(self._answers) > _KEPT_ANSWERS:
                self._answers.popitem(last=False)
        return self._answers[key.hexdigest()]

    def _run(self, pixels: Pixels, tokens: Tokens) -> Boxes:
        height, width = pixels.shape[:2]
        size = self._size or resized_size(height, width)
        given = {
            "pixel_values": picture(pixels, size),
            "pixel_mask": np.ones((1, *size), np.int64),
            "input_ids": tokens.ids,
            "token_type_ids": np.zeros_like(tokens.ids),
            "attention_mask": tokens.attention,
        }
        logits, corners = self._session.run(_OUTPUTS, {name: given[name] for name in self._inputs})
        return read_answer(
            np.asarray(logits, np.float32)[0],
            np.asarray(corners, np.float32)[0],
            tokens,
            height=height,
            width=width,
            text_threshold=self._settings.text_threshold,
        )


def read_answer(
    logits: Float32, boxes: Float32, tokens: Tokens, *, height: int, width: int, text_threshold: float
) -> Boxes:
    """Return the model's outputs as boxes in pixels, scores and labels.

    Parameters
    ----------
    logits : array of shape [n, T], float32
        Of each query and token; -inf where no token is.
    boxes : array of shape [n, 4], float32
        Centre x, y, width, height as fractions of the photo.
    tokens : Tokens
    height, width : int
        Of the photo.
    text_threshold : float
        See `GroundingSettings`.
    """
    count = min(logits.shape[1], len(tokens.words))
    with np.errstate(over="ignore"):  # exp(inf) is what makes the score of -inf 0
        probabilities = 1 / (1 + np.exp(-logits))
    half = boxes[:, 2:] / 2
    corners = np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1)
    corners = corners * np.array([width, height, width, height], np.float32)
    named = probabilities[:, :count] > text_threshold
    labels = tuple(
        _phrase([word for word, is_named in zip(tokens.words, row, strict=False) if is_named]) for row in named
    )
    return Boxes(corners.astype(np.float32), probabilities.max(axis=1), labels)


def _phrase(pieces: list[str]) -> str:
    """Join word pieces as BERT splits them: a piece that goes on starts with "##"."""
    return " ".join(piece for piece in pieces if piece not in ("", ".")).replace(" ##", "").removeprefix("##")


def best_segments(
    boxes: Float32, labels: NDArray[np.int32]
) -> list[tuple[int, float, tuple[float, float, float, float]]]:
    """Return for each box the segment that fits it best: id (0 where none is), fit 0 to 1, and the segment's own box.

    Parameters
    ----------
    boxes : array of shape [n, 4], float32
        x0, y0, x1, y1 in pixels.
    labels : array of shape [H, W], int32
        Segments; 0 is none.

    Notes
    -----
    The fit is IoU(box, box around the segment) times the share of the segment inside the box. The second factor keeps
    a wall behind the object, whose box may be alike, from winning over the object.
    """
    height, width = labels.shape
    areas = np.bincount(labels.ravel())
    places: dict[int, Float32] = {}
    results: list[tuple[int, float, tuple[float, float, float, float]]] = []
    for box in boxes:
        x0, y0 = int(np.clip(np.floor(box[0]), 0, width)), int(np.clip(np.floor(box[1]), 0, height))
        x1, y1 = int(np.clip(np.ceil(box[2]), 0, width)), int(np.clip(np.ceil(box[3]), 0, height))
        inside = np.bincount(labels[y0:y1, x0:x1].ravel(), minlength=len(areas))
        best = (0, 0.0, _as_box(box))
        for number in np.flatnonzero(inside[1:]) + 1:
            if int(number) not in places:
                places[int(number)] = np.array(_extent(labels == number, box), np.float32)
            place = places[int(number)]
            fit = float(_ious(place[None], box)[0]) * float(inside[number] / areas[number])
            if fit > best[1]:
                best = (int(number), fit, _as_box(place))
        results.append(best)
    return results


def _extent(mask: NDArray[np.bool_], otherwise: ArrayLike) -> NDArray[np.float64]:
    """Return x0, y0, x1, y1 around a mask; `otherwise` where it is empty."""
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    if not len(columns):
        return np.asarray(otherwise, np.float64)
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)


def _without_doubles(corners: Float32, order: Sequence[int], max_overlap: float) -> list[int]:
    kept: list[int] = []
    for i in order:
        if not kept or _ious(corners[kept], corners[i]).max() <= max_overlap:
            kept.append(int(i))
    return kept


def _ious(boxes: Float32, box: Float32) -> Float32:
    """Intersection over union of each of `boxes`, shape [n, 4], with one box."""
    sides = np.clip(np.minimum(boxes[:, 2:], box[2:]) - np.maximum(boxes[:, :2], box[:2]), 0, None)
    common = sides.prod(axis=1)
    union = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) + (box[2:] - box[:2]).prod() - common
    return np.asarray(common / np.maximum(union, 1e-9), np.float32)


def _inside(corners: Float32, shape: tuple[int, ...]) -> Float32:
    return np.clip(corners, 0, np.array([shape[1], shape[0], shape[1], shape[0]], np.float32))


def _as_box(box: ArrayLike) -> tuple[float, float, float, float]:
    x0, y0, x1, y1 = (float(value) for value in np.asarray(box).ravel())
    return x0, y0, x1, y1
