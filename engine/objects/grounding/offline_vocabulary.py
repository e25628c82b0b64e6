"""A text detector from an ImageNet classifier, and a small language model that maps prompts to its classes.

Its weights are available without a model hub. A prompt that matches none of the 1,000 classes is rejected, and the
nearest words are listed. Each segment of a photo is cropped, placed on white and classified. See
docs/design_notes/grounding.md.
"""

from __future__ import annotations

import functools
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike

from ...core.arrays import Float32, Mask, Pixels
from ...core.errors import PromptError
from ...core.words import MADE_CLASSES, pictured
from ...install.models import locate, models_folder, multiplies_bfloat16
from .crop_describer import CropDescriber, as_boxes
from .crops import WHITE, Box, cut_out
from .detector import PromptCheck
from .efficientnet import INPUT_SIDE, N_FEATURES, EfficientNetLite2
from .pictures import picture_logits
from .row_cache import RowCache
from .sentences import SentenceEncoder
from .vocabulary import N_CLASSES, Vocabulary
from .wholeness import usual_features, whole_odds

Score = TypeVar("Score", float, Float32)

_BATCH_SIZE = 4
_BLUR = 0.4
"""Standard deviation, in pixels of a reduced crop, of the blur that prevents aliasing."""
_MAX_NAMED = 5
"""Words that are given for one object."""
# Class probability that gives a score of 0.5; see `_score`.
_MIDPOINT = 0.1  # chosen on museum_room
# Detections with a lower score are discarded.
_MIN_SCORE = 0.05  # chosen on museum_room
_SURE = 0.3  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Probability of a class from which on it may exclude others."""
_EXCLUDES = 3.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""How much more probable a class is than those of a word which it excludes: a gong is no bell."""
_MAX_CACHED_ROWS = 20_000
"""Largest number of crops whose features are kept in memory, 5 KB each."""

_MAX_CACHED_PHOTOS = 200
"""Largest number of photos whose segments' features are stored on disk, about 200 KB each. A text prompt uses
eight photos of a scene."""


class OfflineVocabulary(CropDescriber):
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

    least_score = _MIN_SCORE

    def __init__(self, cache: Path | None = None) -> None:
        self.name = "offline-vocabulary"
        encoder = SentenceEncoder(locate("minilm", cache), locate("minilm-tokenizer", cache))
        derived = models_folder(cache).parent / "derived"
        self._vocabulary = Vocabulary(encoder, derived)
        weights = locate("efficientnet-lite2", cache)
        self.fingerprint = f"{weights.name}, examples 1"  # the catalogue pins the hash of the file of this name
        self._classifier = EfficientNetLite2(weights, bfloat16=multiplies_bfloat16())
        self._segment_cache = RowCache(
            derived / f"features-{weights.stem}", width=N_FEATURES, max_files=_MAX_CACHED_PHOTOS
        )
        # Features do not depend on the prompt, so they are cached for further prompts on the same photos.
        self._features: OrderedDict[str, Float32] = OrderedDict()
        self._last: tuple[Float32, Float32] | None = None

    def check_prompt(self, prompt: str) -> PromptCheck:
        """Return whether `prompt` matches a class, with the matching or the nearest classes.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        return self._vocabulary.check(prompt)

    def describe_crops(self, pixels: Pixels, boxes: ArrayLike, masks: Sequence[Mask]) -> Float32:
        """Return the pooled features of each mask, first on white, then with dimmed surroundings, [n, 2560].

        See `Detector.describe_crops`. The white background keeps the outline, the dimmed one the surroundings.
        """
        corners = as_boxes(boxes)
        return np.hstack([self._pooled(pixels, corners, masks, dimmed=dimmed) for dimmed in (False, True)])

    def describe_segments(self, pixels: Pixels, boxes: Sequence[Box], masks: Sequence[Mask]) -> Float32:
        """Return the pooled features of each segment on white, [n, 1280].

        A segment takes about 0.06 CPU seconds; the results are stored on disk for further prompts.
        """
        return self._pooled(pixels, boxes, masks, disk_cache=self._segment_cache)

    def word_for(self, row: Float32, prompt: str) -> str:
        """Return the usual word of the most probable class of the prompt."""
        probabilities = self._probabilities(row[None]).mean(axis=(0, 1))
        return self._vocabulary.name(max(self._class_weights(prompt), key=lambda index: probabilities[index]))

    def score_descriptions(self, described: Float32, prompt: str) -> list[float]:
        """Return the score of each row of features; see `Detector.score_descriptions`.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        class_weights = self._class_weights(prompt)
        rows = self._probabilities(described)
        weights = np.array(list(class_weights.values()), np.float32)
        scores = _score(rows[..., list(class_weights)] @ weights).mean(axis=1)
        return [float(score) for score in scores]

    def score_unknown(self, described: Float32, prompt: str) -> list[float] | None:
        """Return the scores for a word that pictures taught, with all classes and words as its rivals.

        See `Detector.score_unknown`.
        """
        number = pictured(prompt)
        if number is None or len(described) == 0:
            return None
        pooled = np.ascontiguousarray(described, np.float32).reshape(len(described), -1, N_FEATURES)
        logits = [self._classifier.classes(torch.from_numpy(pooled)), torch.from_numpy(picture_logits(pooled))]
        found = torch.cat(logits, dim=2).softmax(dim=2)[..., N_CLASSES + number].numpy()
        return [float(score) for score in _score(found).mean(axis=1)]

    def score_vocabulary(self, described: Float32) -> Float32:
        """Return the score of each class of `MADE_CLASSES`, [n, V]; see `Detector.score_vocabulary`."""
        rows = self._probabilities(described)[..., MADE_CLASSES.start : MADE_CLASSES.stop]
        return np.asarray(_score(rows).mean(axis=1), np.float32)

    def fitting_word(self, described: Float32, prompt: str) -> str:
        """Return the most probable class if it clearly excludes those of the prompt; see `Detector.fitting_word`."""
        class_weights = self._class_weights(prompt)
        mean = self._probabilities(described).mean(axis=(0, 1))
        own = sum(float(mean[index]) * weight for index, weight in class_weights.items())
        mean[list(class_weights)] = 0
        best = int(mean.argmax())
        return self._vocabulary.name(best) if mean[best] >= max(_SURE, _EXCLUDES * own) else ""

    def name_descriptions(self, described: Float32) -> list[tuple[str, float]]:
        """Return the five most probable words for the object of all rows; see `Detector.name_descriptions`.

        Notes
        -----
        The class probabilities are averaged, so that a class that fits only one view gets a low value.
        """
        if len(described) == 0:
            return []
        mean = self._probabilities(described).mean(axis=(0, 1))
        best = np.argsort(-mean, kind="stable")[:_MAX_NAMED]
        return [(self._vocabulary.name(int(index)), _score(float(mean[index]))) for index in best]

    def example_vectors(self, described: Float32) -> Float32:
        """Return the square roots of the features, which are not negative, [n, 2560]; see `Detector.example_vectors`.

        A few features are far larger than the others, and would decide alone.
        """
        return np.sqrt(np.maximum(described, 0))

    def usual_example(self) -> Float32:
        """Return the mean of the same over what may be objects in rooms, [2560]."""
        return usual_features()

    def whole_odds(self, described: Float32) -> Float32:
        """Return how whole each crop looks by `wholeness.whole_odds`; see `Detector.whole_odds`."""
        return whole_odds(described)

    def _probabilities(self, described: Float32) -> Float32:
        """Return the probabilities of the classes by each crop of the rows, [n, crops, 1000].

        Those of the last descriptions are kept: all words of a scene are compared with the same ones.
        """
        if self._last is None or self._last[0] is not described:
            pooled = np.ascontiguousarray(described, np.float32).reshape(-1, N_FEATURES)
            found = self._classifier.classes(torch.from_numpy(pooled)).softmax(dim=1).numpy()
            n_crops = max(described.shape[1] // N_FEATURES, 1)  # rows without anything: nothing was described
            self._last = described, np.asarray(found, np.float32).reshape(len(described), n_crops, N_CLASSES)
        return self._last[1]

    def _class_weights(self, prompt: str) -> dict[int, float]:
        class_weights = self._vocabulary.class_weights(prompt)
        if not class_weights:
            raise PromptError(self._vocabulary.check(prompt).message)
        return class_weights

    def _pooled(
        self,
        pixels: Pixels,
        boxes: Sequence[Box],
        masks: Sequence[Mask],
        *,
        disk_cache: RowCache | None = None,
        dimmed: bool = False,
    ) -> Float32:
        """Return the pooled features of each crop, shape [n, 1280]."""
        if not boxes:
            return np.zeros((0, N_FEATURES), np.float32)
        digest = sha256(np.ascontiguousarray(pixels).data)
        digest.update(repr((pixels.shape, boxes, *(["dimmed"] if dimmed else []))).encode())
        for mask in masks:
            digest.update(np.packbits(mask).data)
        key = digest.hexdigest()
        if key not in self._features:
            rows = None if disk_cache is None else disk_cache.get(key)
            if rows is None or len(rows) != len(boxes):
                crops = [
                    functools.partial(_crop, pixels, box, mask, dimmed) for box, mask in zip(boxes, masks, strict=True)
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


def _score(probability: Score) -> Score:
    """Return class probabilities as scores 0 to 1; a probability of `_MIDPOINT` gives 0.5.

    The mapping makes one threshold suitable for easy and hard words. See docs/design_notes/grounding.md for the choice
    of the midpoint.
    """
    return probability / (probability + _MIDPOINT)


def _crop(pixels: Pixels, box: Box, mask: Mask, dimmed: bool) -> Pixels:
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
