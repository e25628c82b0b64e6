"""A text detector from an ImageNet classifier, and a small language model that maps prompts to its classes.

Its weights are available without a model hub. A prompt that matches none of the 1,000 classes is rejected, and the
nearest words are listed. If the segments of a photo are given, each one is cropped, placed on white and classified,
which works much better than the sliding windows used without segments. See docs/design_notes/grounding.md.
"""

from __future__ import annotations

import functools
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike

from ...core.arrays import Float32, Float64, Int32, Mask, Pixels
from ...core.errors import PromptError
from ...core.words import MADE_CLASSES
from ...install.models import locate, models_folder, multiplies_bfloat16
from ...masks import mask_box
from .crops import WHITE, Box, cut_out
from .detector import Detection, PromptCheck
from .efficientnet import INPUT_SIDE, N_FEATURES, EfficientNetLite2
from .row_cache import RowCache
from .sentences import SentenceEncoder
from .vocabulary import N_CLASSES, Vocabulary
from .wholeness import whole_odds
from .windows import find_windows

__all__ = ["OfflineVocabulary"]

_BATCH_SIZE = 4
_BLUR = 0.4
"""Standard deviation, in pixels of a reduced crop, of the blur that prevents aliasing."""
_MAX_NAMED = 5
"""Words that are given for one object."""
# Class probability that gives a score of 0.5; see `_score`.
_MIDPOINT = 0.1  # chosen on museum_room
# Detections with a lower score are discarded.
_MIN_SCORE = 0.05  # chosen on museum_room
# Segments that cover a smaller or larger fraction of the photo are not classified.
_MIN_SEGMENT_FRACTION = 0.001  # chosen on museum_room
_MAX_SEGMENT_FRACTION = 0.5  # chosen on museum_room
_MAX_CACHED_ROWS = 20_000
"""Largest number of crops whose features are kept in memory, 5 KB each."""

_MAX_CACHED_PHOTOS = 200
"""Largest number of photos whose segments' features are stored on disk, about 200 KB each. A text prompt uses
eight photos of a scene."""


class OfflineVocabulary:
    """EfficientNet-Lite2 for pictures, all-MiniLM-L6-v2 for words.

    Parameters
    ----------
    cache : Path or None
        See `models.models_folder`.

    Raises
    ------
    ModelFileError
        When a weight file is missing or damaged; the message contains the command that fetches it.
    """

    fitted = True

    def __init__(self, cache: Path | None = None) -> None:
        self.name = "offline-vocabulary"
        encoder = SentenceEncoder(locate("minilm", cache), locate("minilm-tokenizer", cache))
        derived = models_folder(cache).parent / "derived"
        self._vocabulary = Vocabulary(encoder, derived)
        weights = locate("efficientnet-lite2", cache)
        self._classifier = EfficientNetLite2(weights, bfloat16=multiplies_bfloat16())
        self._segment_cache = RowCache(
            derived / f"features-{weights.stem}", width=N_FEATURES, max_files=_MAX_CACHED_PHOTOS
        )
        # Features do not depend on the prompt, so they are cached for further prompts on the same photos.
        self._features: OrderedDict[str, Float32] = OrderedDict()

    def check_prompt(self, prompt: str) -> PromptCheck:
        """Return whether `prompt` matches a class, with the matching or the nearest classes.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        return self._vocabulary.check(prompt)

    def detect(self, pixels: Pixels, prompt: str, *, labels: Int32 | None = None) -> list[Detection]:
        """Return the detections, best first; see `Detector.detect`.

        Notes
        -----
        With `labels`, each segment is classified in about 0.06 CPU seconds; the results are stored on disk for further
        prompts. Without, windows of several sizes are classified, which takes as long as about 40 segments and gives
        less accurate boxes.
        """
        class_weights = self._class_weights(prompt)
        if labels is None:
            detections = [
                Detection(window.box, _score(window.probability), self._vocabulary.name(window.class_index))
                for window in find_windows(self._classifier, pixels, class_weights)
            ]
        else:
            detections = self._classify_segments(pixels, labels, class_weights)
        detections = [detection for detection in detections if detection.score >= _MIN_SCORE]
        return sorted(detections, key=lambda detection: -detection.score)

    def score_crops(
        self,
        pixels: Pixels,
        boxes: ArrayLike,
        prompt: str,
        *,
        masks: Sequence[Mask] | None = None,
    ) -> list[float]:
        """Return how well each box, or each mask if given, matches `prompt`; see `Detector.score_crops`.

        The score of a mask is the mean of that with its surroundings replaced with white and of that with its
        surroundings dimmed.
        """
        corners = [_as_box(box) for box in np.asarray(boxes, np.float64).reshape(-1, 4)]
        if masks is not None and len(masks) != len(corners):
            raise ValueError(f"{len(corners)} boxes and {len(masks)} masks")
        described = (
            self._probabilities(self._pooled(pixels, corners, None))
            if masks is None
            else self.describe_crops(pixels, boxes, masks)
        )
        return self.score_descriptions(described, prompt)

    def describe_crops(self, pixels: Pixels, boxes: ArrayLike, masks: Sequence[Mask]) -> Float32:
        """Return the probabilities of the classes on white and with dimmed surroundings, and `whole_odds`, [n, 2001].

        See `Detector.describe_crops`. The white background keeps the outline, the dimmed one the surroundings.
        """
        features = self.features_of_crops(pixels, boxes, masks)
        rows = self._probabilities(features.reshape(-1, N_FEATURES)).reshape(-1, 2 * N_CLASSES)
        return np.hstack([rows, whole_odds(features)[:, None]])

    def score_descriptions(self, described: Float32, prompt: str) -> list[float]:
        """Return the score of each row of class probabilities; see `Detector.score_descriptions`.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        class_weights = self._class_weights(prompt)
        rows = _rows(described)
        scores = np.array([_score(_total_probability(row, class_weights)) for row in rows])
        return [float(score) for score in scores.reshape(len(described), -1).mean(axis=1)] if len(rows) else []

    def score_vocabulary(self, described: Float32) -> Float32:
        """Return the score of each class of `MADE_CLASSES`, [n, V]; see `Detector.score_vocabulary`."""
        rows = _rows(described)[:, MADE_CLASSES.start : MADE_CLASSES.stop]
        scores = rows / (rows + _MIDPOINT)
        return np.asarray(scores.reshape(len(described), -1, len(MADE_CLASSES)).mean(axis=1), np.float32)

    def name_descriptions(self, described: Float32) -> list[tuple[str, float]]:
        """Return the five most probable words for the object of all rows; see `Detector.name_descriptions`.

        Notes
        -----
        The class probabilities are averaged, so that a class that fits only one view gets a low value.
        """
        if len(described) == 0:
            return []
        mean = _rows(described).mean(axis=0)
        best = np.argsort(-mean, kind="stable")[:_MAX_NAMED]
        return [(self._vocabulary.name(int(index)), _score(float(mean[index]))) for index in best]

    def whole_odds(self, described: Float32) -> Float32:
        """Return the last column of the descriptions; see `Detector.whole_odds`."""
        return described[:, -1]

    def features_of_crops(self, pixels: Pixels, boxes: ArrayLike, masks: Sequence[Mask]) -> Float32:
        """Return the pooled features of each mask, first on white, then with dimmed surroundings.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB
        boxes : array-like of shape [n, 4]
            x0, y0, x1, y1 in pixels.
        masks : sequence of n bool arrays of shape [H, W]

        Returns
        -------
        array of shape [n, 2560], float32
        """
        corners = [_as_box(box) for box in np.asarray(boxes, np.float64).reshape(-1, 4)]
        return np.hstack([self._pooled(pixels, corners, masks, dimmed=dimmed) for dimmed in (False, True)])

    def _probabilities(self, features: Float32) -> Float32:
        """Return the probabilities of the classes, [n, 1000]."""
        return np.asarray(self._classifier.classes(torch.from_numpy(features)).softmax(dim=1).numpy(), np.float32)

    def _class_weights(self, prompt: str) -> dict[int, float]:
        class_weights = self._vocabulary.class_weights(prompt)
        if not class_weights:
            raise PromptError(self._vocabulary.check(prompt).message)
        return class_weights

    def _classify_segments(self, pixels: Pixels, labels: Int32, class_weights: dict[int, float]) -> list[Detection]:
        height, width = pixels.shape[:2]
        if labels.shape != (height, width):
            labels = cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST)
        segment_ids, areas = np.unique(labels, return_counts=True)
        suitable = (
            (segment_ids > 0)
            & (areas >= _MIN_SEGMENT_FRACTION * labels.size)
            & (areas <= _MAX_SEGMENT_FRACTION * labels.size)
        )
        masks = [labels == segment_id for segment_id in segment_ids[suitable]]
        boxes = [_box_of(mask) for mask in masks]
        detections = []
        rows = self._probabilities(self._pooled(pixels, boxes, masks, disk_cache=self._segment_cache))
        for segment_id, box, row in zip(segment_ids[suitable], boxes, rows, strict=True):
            best_class = max(class_weights, key=lambda index: row[index])
            score = _score(_total_probability(row, class_weights))
            detections.append(Detection(box, score, self._vocabulary.name(best_class), int(segment_id)))
        return detections

    def _pooled(
        self,
        pixels: Pixels,
        boxes: list[Box],
        masks: Sequence[Mask] | None,
        *,
        disk_cache: RowCache | None = None,
        dimmed: bool = False,
    ) -> Float32:
        """Return the pooled features of each crop, shape [n, 1280]."""
        if not boxes:
            return np.zeros((0, N_FEATURES), np.float32)
        digest = sha256(np.ascontiguousarray(pixels).data)
        digest.update(repr((pixels.shape, boxes, *(["dimmed"] if dimmed else []))).encode())
        for mask in masks or ():
            digest.update(np.packbits(mask).data)
        key = digest.hexdigest()
        if key not in self._features:
            rows = None if disk_cache is None else disk_cache.get(key)
            if rows is None or len(rows) != len(boxes):
                shown: Sequence[Mask | None] = masks or [None] * len(boxes)
                crops = [
                    functools.partial(_crop, pixels, box, mask, dimmed) for box, mask in zip(boxes, shown, strict=True)
                ]
                rows = np.concatenate(self._run_classifier(crops))
                if disk_cache is not None:
                    disk_cache.put(key, rows)
            self._features[key] = rows
            while sum(len(rows) for rows in self._features.values()) > _MAX_CACHED_ROWS:
                self._features.popitem(last=False)
        return self._features[key]

    def _run_classifier(self, crops: Sequence[Callable[[], Pixels]]) -> list[Float32]:
        """Return the pooled features of what `crops` return, in batches, each computed by one thread.

        Threads within one operation wait for each other by spinning, which wastes CPU time in the small layers of this
        network; see docs/design_notes/grounding.md.
        """

        def pooled(batch: Sequence[Callable[[], Pixels]]) -> Float32:
            pictures = torch.from_numpy(np.stack([crop() for crop in batch])).permute(0, 3, 1, 2).float()
            return np.asarray(self._classifier.pooled(pictures).numpy(), np.float32)

        batches = [crops[start : start + _BATCH_SIZE] for start in range(0, len(crops), _BATCH_SIZE)]
        threads = torch.get_num_threads()
        try:
            with ThreadPoolExecutor(max_workers=threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
                return list(pool.map(pooled, batches))
        finally:
            torch.set_num_threads(threads)


def _rows(described: Float32) -> Float32:
    """Return the class probabilities of each crop and background, [2n, 1000], or [n, 1000] of boxes without masks."""
    return described[:, : described.shape[1] // N_CLASSES * N_CLASSES].reshape(-1, N_CLASSES)


def _total_probability(row: Float32, class_weights: dict[int, float]) -> float:
    """Return the weighted sum of the class probabilities of one crop."""
    return float(sum(row[index] * weight for index, weight in class_weights.items()))


def _score(probability: float) -> float:
    """Return a class probability as a score 0 to 1; a probability of `_MIDPOINT` gives 0.5.

    The mapping makes one threshold suitable for easy and hard words. See docs/design_notes/grounding.md for the choice
    of the midpoint.
    """
    return probability / (probability + _MIDPOINT)


def _as_box(box: Float64) -> Box:
    return float(box[0]), float(box[1]), float(box[2]), float(box[3])


def _box_of(mask: Mask) -> Box:
    box = mask_box(mask)
    assert box is not None, "a segment has at least one pixel"
    return float(box[0]), float(box[1]), float(box[2]), float(box[3])


def _crop(pixels: Pixels, box: Box, mask: Mask | None, dimmed: bool) -> Pixels:
    """Return a square crop around `box`, resized to the classifier's input, shape [260, 260, 3]."""
    cut = cut_out(pixels, box, mask, "dimmed" if dimmed else "white")
    part, scale = cut.pixels, INPUT_SIDE / cut.side
    if scale < 1:
        # Prevents aliasing, because warpAffine interpolates between four pixels at any scale.
        part = cv2.GaussianBlur(part, (0, 0), _BLUR / scale)
    target_from_part = np.array(
        [[scale, 0, (cut.x - cut.left + 0.5) * scale - 0.5], [0, scale, (cut.y - cut.top + 0.5) * scale - 0.5]]
    )
    crop = cv2.warpAffine(
        part,
        target_from_part,
        (INPUT_SIDE, INPUT_SIDE),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(WHITE,) * 3,
    )
    return np.asarray(np.clip(np.rint(crop), 0, 255), np.uint8)
