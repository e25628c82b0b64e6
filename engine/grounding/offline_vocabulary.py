"""The detector that needs no hub: an ImageNet classifier, and a small language model that maps prompts to its classes.

It is honest about being narrow: a prompt none of whose meanings is among 1,000 classes is refused, with the nearest
words. Given the segments of a photo it classifies each one cut out on white, which works much better than sliding a
window, its way when there are no segments.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from ..errors import PromptError
from ..models import locate, models_folder
from .detector import Detection, PromptCheck
from .efficientnet import INPUT_SIDE, EfficientNetLite2
from .kept_rows import KeptRows
from .sentences import SentenceEncoder
from .vocabulary import N_CLASSES, Vocabulary
from .windows import find_windows

__all__ = ["OfflineVocabulary"]

Pixels = NDArray[np.uint8]
Float32 = NDArray[np.float32]
Box = tuple[float, float, float, float]

# Cut out on white with a fifth of its size as a margin on each side: of grey, white, blurred and the photo's own
# surroundings, and of margins from 0 to 0.5, this named most of the museum room's exhibits rightly (top 1: 79 %;
# in their surroundings 50 %).
_MARGIN = 0.2
_WHITE = 255
_BATCH = 4
# Probabilities that turn into a score of 0.5: of a word that is asked for, of a name that is suggested; see `_score`.
_EVEN_OF_WORD = 0.1
_EVEN_OF_NAME = 0.02
_MIN_SCORE = 0.05
_MIN_SEGMENT = 0.001
_MAX_SEGMENT = 0.5
_KEPT_ROWS = 20_000
"""Crops whose probabilities are kept in memory, 4 KB each."""

_KEPT_PHOTOS = 200
"""Photos whose segments' probabilities are kept on disk, about 160 KB each: a text looks at eight of a scene."""


class OfflineVocabulary:
    """EfficientNet-Lite2 for pictures, all-MiniLM-L6-v2 for words.

    Parameters
    ----------
    cache : Path or None
        See `models.catalogue.models_folder`.

    Raises
    ------
    ModelFileError
        When a weight file is missing or damaged; the sentence holds the command that fetches it.
    """

    def __init__(self, cache: Path | None = None) -> None:
        self.name = "offline-vocabulary"
        encoder = SentenceEncoder(locate("minilm", cache), locate("minilm-tokenizer", cache))
        derived = models_folder(cache).parent / "derived"
        self._vocabulary = Vocabulary(encoder, derived)
        weights = locate("efficientnet-lite2", cache)
        self._classifier = EfficientNetLite2(weights)
        self._segments = KeptRows(derived / f"segments-{weights.stem}", width=N_CLASSES, most=_KEPT_PHOTOS)
        # Class probabilities do not depend on the prompt: a second prompt for the same photos is free.
        self._probabilities: OrderedDict[str, Float32] = OrderedDict()

    def knows(self, prompt: str) -> PromptCheck:
        """Return whether `prompt` means one of the classes, with the classes or the nearest ones.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        return self._vocabulary.check(prompt)

    def detect(self, pixels: Pixels, prompt: str, *, labels: NDArray[np.int32] | None = None) -> list[Detection]:
        """Return what was found, best first; see `Detector.detect`.

        Notes
        -----
        With `labels` one classification a segment, about 0.06 CPU seconds each, kept on disk for further prompts;
        without, windows of several sizes over the photo, about as much as 40 segments, and boxes that are rough.
        """
        weights = self._weights(prompt)
        if labels is None:
            found = [
                Detection(window.box, _score(window.probability, _EVEN_OF_WORD), self._vocabulary.name(window.number))
                for window in find_windows(self._classifier, pixels, weights)
            ]
        else:
            found = self._among_segments(pixels, labels, weights)
        return sorted((one for one in found if one.score >= _MIN_SCORE), key=lambda one: -one.score)

    def score_crops(
        self,
        pixels: Pixels,
        boxes: ArrayLike,
        prompt: str,
        *,
        masks: Sequence[NDArray[np.bool_]] | None = None,
    ) -> list[float]:
        """Return how well each box, or better each mask, shows what `prompt` names.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB
        boxes : array-like of shape [n, 4]
            x0, y0, x1, y1 in pixels.
        prompt : str
        masks : sequence of n bool arrays of shape [H, W], or None
            The object in each box; what surrounds it is then painted white.

        Returns
        -------
        list of n float
            0 to 1, as in `Detection.score`.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        places = [_as_box(box) for box in np.asarray(boxes, np.float64).reshape(-1, 4)]
        if masks is not None and len(masks) != len(places):
            raise ValueError(f"{len(places)} boxes and {len(masks)} masks")
        return self.score_described(self._classify(pixels, places, masks), prompt)

    def describe_crops(self, pixels: Pixels, boxes: ArrayLike, masks: Sequence[NDArray[np.bool_]]) -> Float32:
        """Return the probabilities of the classes, shape [n, 1000]; see `Detector.describe_crops`."""
        places = [_as_box(box) for box in np.asarray(boxes, np.float64).reshape(-1, 4)]
        return self._classify(pixels, places, masks)

    def score_described(self, described: Float32, prompt: str) -> list[float]:
        """Return the score of each row of class probabilities; see `Detector.score_described`.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        weights = self._weights(prompt)
        return [_score(_meant(row, weights), _EVEN_OF_WORD) for row in described]

    def name_crops(self, crops: Sequence[tuple[Pixels, ArrayLike, NDArray[np.bool_]]]) -> list[tuple[str, float]]:
        """Return the five likeliest words for what all crops show; see `Detector.name_crops`.

        Notes
        -----
        Probabilities of the classes, averaged over the crops: what looks like something else from one side only loses.
        """
        rows = [
            self._classify(pixels, [_as_box(np.asarray(box, np.float64))], [mask])[0] for pixels, box, mask in crops
        ]
        if not rows:
            return []
        mean = np.mean(rows, axis=0)
        best = np.argsort(-mean, kind="stable")[:5]
        return [(self._vocabulary.name(int(number)), _score(float(mean[number]), _EVEN_OF_NAME)) for number in best]

    def _weights(self, prompt: str) -> dict[int, float]:
        weights = self._vocabulary.weights(prompt)
        if not weights:
            raise PromptError(self._vocabulary.check(prompt).message)
        return weights

    def _among_segments(self, pixels: Pixels, labels: NDArray[np.int32], weights: dict[int, float]) -> list[Detection]:
        height, width = pixels.shape[:2]
        if labels.shape != (height, width):
            labels = cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST)
        numbers, areas = np.unique(labels, return_counts=True)
        fits = (numbers > 0) & (areas >= _MIN_SEGMENT * labels.size) & (areas <= _MAX_SEGMENT * labels.size)
        masks = [labels == number for number in numbers[fits]]
        boxes = [_box_of(mask) for mask in masks]
        found = []
        rows = self._classify(pixels, boxes, masks, kept=self._segments)
        for number, box, row in zip(numbers[fits], boxes, rows, strict=True):
            best = max(weights, key=lambda one: row[one])
            score = _score(_meant(row, weights), _EVEN_OF_WORD)
            found.append(Detection(box, score, self._vocabulary.name(best), int(number)))
        return found

    def _classify(
        self,
        pixels: Pixels,
        boxes: list[Box],
        masks: Sequence[NDArray[np.bool_]] | None,
        *,
        kept: KeptRows | None = None,
    ) -> Float32:
        """Class probabilities of each crop, shape [n, 1000]."""
        if not boxes:
            return np.zeros((0, N_CLASSES), np.float32)
        digest = sha256(np.ascontiguousarray(pixels).data)
        digest.update(repr((pixels.shape, boxes)).encode())
        for mask in masks or ():
            digest.update(np.packbits(mask).data)
        key = digest.hexdigest()
        if key not in self._probabilities:
            rows = None if kept is None else kept.get(key)
            if rows is None or len(rows) != len(boxes):
                crops = [_crop(pixels, box, None if masks is None else masks[i]) for i, box in enumerate(boxes)]
                rows = np.concatenate(self._probabilities_of(crops))
                if kept is not None:
                    kept.put(key, rows)
            self._probabilities[key] = rows
            while sum(len(rows) for rows in self._probabilities.values()) > _KEPT_ROWS:
                self._probabilities.popitem(last=False)
        return self._probabilities[key]

    def _probabilities_of(self, crops: Sequence[Pixels]) -> list[Float32]:
        """Return class probabilities in batches, each in a thread of its own.

        Threads inside of an operation wait for each other by spinning: the network's layers are so small that on a busy
        machine they spent ten times the CPU seconds of one thread (0.7 against 0.07 a crop).
        """

        def answer(batch: Sequence[Pixels]) -> Float32:
            pictures = torch.from_numpy(np.stack(batch)).permute(0, 3, 1, 2).float()
            return np.asarray(self._classifier.logits(pictures).softmax(dim=1).numpy(), np.float32)

        batches = [crops[start : start + _BATCH] for start in range(0, len(crops), _BATCH)]
        threads = torch.get_num_threads()
        try:
            with ThreadPoolExecutor(max_workers=threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
                return list(pool.map(answer, batches))
        finally:
            torch.set_num_threads(threads)


def _meant(row: Float32, weights: dict[int, float]) -> float:
    return float(sum(row[number] * weight for number, weight in weights.items()))


def _score(probability: float, even: float) -> float:
    """Map a class probability to 0..1 so that thresholds mean the same for easy and hard words.

    Among 1,000 classes, many of them near synonyms, the likeliest is right about as often as wrong from 0.02 on. Of a
    word that is asked for, whether it is there or not, the best of some hundred segments is looked at: one in twenty
    words for nothing in the museum room still reaches 0.04 there.
    """
    return probability / (probability + even)


def _as_box(box: NDArray[np.float64]) -> Box:
    return float(box[0]), float(box[1]), float(box[2]), float(box[3])


def _box_of(mask: NDArray[np.bool_]) -> Box:
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    return float(columns[0]), float(rows[0]), float(columns[-1] + 1), float(rows[-1] + 1)


def _crop(pixels: Pixels, box: Box, mask: NDArray[np.bool_] | None) -> Pixels:
    """Cut a square around `box` and bring it to the classifier's size, shape [260, 260, 3]."""
    margin = 0.0 if mask is None else _MARGIN
    side = max(box[2] - box[0], box[3] - box[1], 1.0) * (1 + 2 * margin)
    left, top = (box[0] + box[2] - side) / 2, (box[1] + box[3] - side) / 2
    x0, y0 = max(0, int(np.floor(left))), max(0, int(np.floor(top)))
    x1, y1 = min(pixels.shape[1], int(np.ceil(left + side))), min(pixels.shape[0], int(np.ceil(top + side)))
    part = pixels[y0:y1, x0:x1].astype(np.float32)
    if mask is not None:
        part[~mask[y0:y1, x0:x1]] = _WHITE
    scale = INPUT_SIDE / side
    if scale < 1:
        # Against aliasing; warpAffine takes four neighbours whatever the scale.
        part = cv2.GaussianBlur(part, (0, 0), 0.4 / scale)
    target_from_part = np.array(
        [[scale, 0, (x0 - left + 0.5) * scale - 0.5], [0, scale, (y0 - top + 0.5) * scale - 0.5]]
    )
    crop = cv2.warpAffine(
        part,
        target_from_part,
        (INPUT_SIDE, INPUT_SIDE),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(_WHITE,) * 3,
    )
    return np.asarray(np.clip(np.rint(crop), 0, 255), np.uint8)
