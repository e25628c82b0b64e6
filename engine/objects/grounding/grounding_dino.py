"""Grounding DINO in onnxruntime: boxes with scores for any words, or the segment that fits each box best."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Float32, Float64, Int32, Mask, Pixels
from ...core.errors import ModelFileError
from ...install.models import Session
from ...masks import box_ious, mask_box, suppress_overlapping
from .crop_describer import as_box
from .detector import Detection, Detector, PromptCheck
from .dino_inputs import Tokenizer, Tokens, normalise_picture, resized_size, to_caption

_INPUTS = ("pixel_values", "pixel_mask", "input_ids", "token_type_ids", "attention_mask")
_OUTPUTS = ["logits", "pred_boxes"]
_MAX_CACHED_PREDICTIONS = 256
"""Predictions (one per photo and prompt) kept in memory: 18 KB each for 900 boxes, and their labels."""


@dataclass(frozen=True)
class GroundingSettings:
    """Criteria for keeping boxes of Grounding DINO.

    The defaults are between those of the paper "Gaussian Heritage" and of the model's demo. They were not measured.

    Attributes
    ----------
    box_threshold : float
        Boxes whose best token has a lower score are discarded.
    text_threshold : float
        Tokens of the prompt with a higher score form the label of a box.
    max_overlap : float
        Of two boxes whose IoU is higher than this value, the one with the lower score is discarded; 1 keeps all boxes.
    min_fit : float
        If segments are given, boxes whose best segment has a smaller fit (0 to 1) are discarded; see `best_segments`.
    """

    box_threshold: float = 0.3  # Dahaghin et al. 2024
    text_threshold: float = 0.25  # Liu et al. 2023
    max_overlap: float = 0.7  # chosen on museum_room
    min_fit: float = 0.2  # chosen on museum_room


@dataclass(frozen=True)
class Boxes:
    """All boxes predicted by the model, one row per query.

    Attributes
    ----------
    corners : array of shape [n, 4], float32
        x0, y0, x1, y1 in photo pixels; may extend slightly beyond the photo.
    scores : array of shape [n], float32
        Score of the best token.
    labels : tuple of str
        Words of the prompt whose tokens have scores above the text threshold.
    """

    corners: Float32
    scores: Float32
    labels: tuple[str, ...]


class GroundingDino(Detector):
    """A Grounding DINO export with the inputs and outputs of ``transformers``.

    Parameters
    ----------
    name : str
        As the catalogue calls it.
    session : Session
        Open.
    tokenizer : Path
        The ``tokenizer.json`` of the export.

    Raises
    ------
    ModelFileError
        When the session is that of another model, or the tokenizer file is missing or damaged.

    References
    ----------
    Liu et al., "Grounding DINO: Marrying DINO with Grounded Pre-Training for Open-Set Object Detection", 2023.
    """

    fingerprint = ""

    def __init__(self, name: str, session: Session, tokenizer: Path, settings: GroundingSettings | None = None) -> None:
        self.name = name
        self._settings = settings or GroundingSettings()
        self._session = session
        shapes = {node.name: list(node.shape) for node in session.get_inputs()}
        outputs = {node.name for node in session.get_outputs()}
        if not set(shapes) <= set(_INPUTS) or not {"pixel_values", "input_ids"} <= set(shapes):
            raise ModelFileError(f"{name} has the inputs {', '.join(shapes)}: it is not a Grounding DINO export.")
        if not set(_OUTPUTS) <= outputs:
            raise ModelFileError(f"{name} has the outputs {', '.join(outputs)}: it is not a Grounding DINO export.")
        self._inputs = list(shapes)
        # A fixed dimension is a number, a free one is a name or None.
        height, width = shapes["pixel_values"][2:4]
        self._size = (height, width) if isinstance(height, int) and isinstance(width, int) else None
        length = shapes["input_ids"][1]
        self._length = length if isinstance(length, int) else None
        self._tokenizer = Tokenizer(tokenizer)
        self._predictions: OrderedDict[str, Boxes] = OrderedDict()

    def check_prompt(self, prompt: str) -> PromptCheck:
        """Return that the detector can look for `prompt`: it accepts any words.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        to_caption(prompt)
        return PromptCheck(True, [], f"{self.name} looks for any words; it was trained on English ones.")

    def detect(self, pixels: Pixels, prompt: str, *, labels: Int32 | None = None) -> list[Detection]:
        """Return the detections, best first; see `Detector.detect`.

        Notes
        -----
        A box without a token above the text threshold is labelled with the prompt itself. With `labels`, each box is
        replaced with the segment that fits it best (`best_segments`). Boxes that no segment fits are discarded, and of
        several boxes with the same segment only the best is kept.
        """
        predicted = self.predict_boxes(pixels, prompt)
        likely = np.flatnonzero(predicted.scores > self._settings.box_threshold)
        kept = likely[
            suppress_overlapping(predicted.corners[likely], predicted.scores[likely], self._settings.max_overlap)
        ]
        boxes = _clip_to_photo(predicted.corners[kept], pixels.shape)
        detections = [
            Detection(as_box(box), float(predicted.scores[i]), predicted.labels[i] or prompt.strip())
            for i, box in zip(kept, boxes, strict=True)
        ]
        if labels is None:
            return detections
        if labels.shape != pixels.shape[:2]:
            labels = cv2.resize(labels, pixels.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        by_segment: dict[int, Detection] = {}
        for detection, (region, fit, box) in zip(detections, best_segments(boxes, labels), strict=True):
            if region and fit >= self._settings.min_fit and region not in by_segment:
                by_segment[region] = Detection(box, detection.score, detection.label, region)
        return list(by_segment.values())

    def predict_boxes(self, pixels: Pixels, prompt: str) -> Boxes:
        """Return all boxes of the model, including those below the threshold; cached per photo and prompt.

        Raises
        ------
        PromptError
            When the prompt is empty or too long.
        """
        text = to_caption(prompt)
        key = sha256(np.ascontiguousarray(pixels).data)
        key.update(repr((pixels.shape, text)).encode())
        if key.hexdigest() not in self._predictions:
            self._predictions[key.hexdigest()] = self._run(pixels, self._tokenizer(text, self._length))
            if len(self._predictions) > _MAX_CACHED_PREDICTIONS:
                self._predictions.popitem(last=False)
        return self._predictions[key.hexdigest()]

    def _run(self, pixels: Pixels, tokens: Tokens) -> Boxes:
        height, width = pixels.shape[:2]
        size = self._size or resized_size(height, width)
        inputs = {
            "pixel_values": normalise_picture(pixels, size),
            "pixel_mask": np.ones((1, *size), np.int64),
            "input_ids": tokens.ids,
            "token_type_ids": np.zeros_like(tokens.ids),
            "attention_mask": tokens.attention,
        }
        logits, corners = self._session.run(_OUTPUTS, {name: inputs[name] for name in self._inputs})
        return decode_outputs(
            np.asarray(logits, np.float32)[0],
            np.asarray(corners, np.float32)[0],
            tokens,
            height=height,
            width=width,
            text_threshold=self._settings.text_threshold,
        )


def decode_outputs(
    logits: Float32, boxes: Float32, tokens: Tokens, *, height: int, width: int, text_threshold: float
) -> Boxes:
    """Return the boxes in pixels, scores and labels for the model's outputs.

    Parameters
    ----------
    logits : array of shape [n, T], float32
        Logits of each query and token; -inf for positions without a token.
    boxes : array of shape [n, 4], float32
        Centre x, y, width, height as fractions of the photo.
    height, width : int
        Size of the photo.
    text_threshold : float
        See `GroundingSettings`.
    """
    count = min(logits.shape[1], len(tokens.words))
    with np.errstate(over="ignore"):  # exp(inf) gives the score 0 for -inf
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
    """Return the text of BERT's word pieces; "##" marks a piece that continues a word."""
    return " ".join(piece for piece in pieces if piece not in ("", ".")).replace(" ##", "").removeprefix("##")


def best_segments(boxes: Float32, labels: Int32) -> list[tuple[int, float, tuple[float, float, float, float]]]:
    """Return for each box the segment that fits it best: its id (0 for none), the fit 0 to 1, and the segment's box.

    Parameters
    ----------
    boxes : array of shape [n, 4], float32
        x0, y0, x1, y1 in pixels.
    labels : array of shape [H, W], int32
        Segment ids; 0 for unlabelled pixels.

    Notes
    -----
    The fit is IoU(box, box around the segment) times the fraction of the segment inside the box. The second factor
    prevents a wall behind the object, whose box may be similar, from having a higher fit than the object.
    """
    height, width = labels.shape
    areas = np.bincount(labels.ravel())
    segment_boxes: dict[int, Float32] = {}
    results: list[tuple[int, float, tuple[float, float, float, float]]] = []
    for box in boxes:
        x0, y0 = int(np.clip(np.floor(box[0]), 0, width)), int(np.clip(np.floor(box[1]), 0, height))
        x1, y1 = int(np.clip(np.ceil(box[2]), 0, width)), int(np.clip(np.ceil(box[3]), 0, height))
        inside = np.bincount(labels[y0:y1, x0:x1].ravel(), minlength=len(areas))
        best = (0, 0.0, as_box(box))
        for number in np.flatnonzero(inside[1:]) + 1:
            if int(number) not in segment_boxes:
                segment_boxes[int(number)] = np.array(_extent(labels == number, box), np.float32)
            segment_box = segment_boxes[int(number)]
            fit = float(box_ious(segment_box[None], box)[0]) * float(inside[number] / areas[number])
            if fit > best[1]:
                best = (int(number), fit, as_box(segment_box))
        results.append(best)
    return results


def _extent(mask: Mask, default: ArrayLike) -> Float64:
    """Return the bounding box x0, y0, x1, y1 of a mask; `default` if it is empty."""
    box = mask_box(mask)
    return np.asarray(default if box is None else box, np.float64)


def _clip_to_photo(corners: Float32, shape: tuple[int, ...]) -> Float32:
    return np.clip(corners, 0, np.array([shape[1], shape[0], shape[1], shape[0]], np.float32))
