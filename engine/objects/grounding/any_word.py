"""A text detector for any words: an image-text encoder that describes the crops of what may be objects.

Nothing here was fitted to the weights of an encoder. A word is compared with the words of the vocabulary, and
refused by the scores of these, see `engine.objects.looks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Float32, Int32, Int64, Mask, Pixels
from ...core.errors import PromptError
from ...core.words import MADE_CLASSES, normalised, word_list
from ...install.models import models_folder
from ...masks import mask_box
from .crops import Background, Box, cut_out
from .detector import Detection, PromptCheck
from .image_text import ImageTextEncoder, load_encoder
from .kept_vectors import kept_vectors
from .offline_vocabulary import OfflineVocabulary

__all__ = ["AnyWord"]

_BACKGROUNDS: tuple[Background, ...] = ("white", "blurred")
"""What becomes of the surroundings of a crop; each is described on its own."""
_SCALE = 100.0  # Radford et al. 2021
"""Factor of a cosine that gives a logit."""
_N_ALIKE = 5
"""Words of the vocabulary, the nearest by meaning, that do not speak against a word: *vase* not against *amphora*. Not
fitted; it acts on all words alike, so that no share of refused words depends on it."""
_MAX_NAMED = 5
_WINDOWS = (1, 2, 3, 5)
"""Windows along the shorter side of a photo without segments; the next begins in the middle of one."""
_MIN_SEGMENT_FRACTION, _MAX_SEGMENT_FRACTION = 0.001, 0.5  # chosen on museum_room
"""Smaller and larger segments of a photo are not described, as by the offline vocabulary."""


class AnyWord:
    """An image-text encoder for pictures and words, and the offline vocabulary for how whole a crop looks.

    Parameters
    ----------
    name : str
        One of `image_text.ENCODERS`.
    cache : Path or None
        See `models.models_folder`.

    Raises
    ------
    ModelFileError
        When a weight file is missing, damaged or that of another model.
    """

    fitted = False

    def __init__(self, name: str, cache: Path | None = None) -> None:
        self._open(load_encoder(name, cache), OfflineVocabulary(cache), models_folder(cache).parent / "derived")

    @classmethod
    def from_encoder(cls, encoder: ImageTextEncoder, classifier: OfflineVocabulary, derived: Path | None) -> AnyWord:
        """Return a detector for an open encoder; `derived` is the folder of kept vectors, or None to keep none."""
        detector = cls.__new__(cls)
        detector._open(encoder, classifier, derived)
        return detector

    def _open(self, encoder: ImageTextEncoder, classifier: OfflineVocabulary, derived: Path | None) -> None:
        self.name = encoder.name
        self._encoder, self._classifier, self._derived = encoder, classifier, derived
        # Different birds are called crane.
        self._words = list(dict.fromkeys(entry.words[0] for entry in word_list().classes))

    def check_prompt(self, prompt: str) -> PromptCheck:
        """Return that the detector can look for `prompt`: it accepts any words; raises `PromptError` for none."""
        _required(prompt)
        return PromptCheck(True, [], f"{self.name} looks for any words.")

    def detect(self, pixels: Pixels, prompt: str, *, labels: Int32 | None = None) -> list[Detection]:
        """Return the detections, best first; see `Detector.detect`.

        Without `labels`, windows of several sizes are scored: boxes are then as coarse as these.
        """
        height, width = pixels.shape[:2]
        if labels is None:
            boxes, masks, regions = _windows(height, width), None, None
        else:
            if labels.shape != (height, width):
                labels = cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST)
            numbers, areas = np.unique(labels, return_counts=True)
            share = areas / labels.size
            suitable = (numbers > 0) & (share >= _MIN_SEGMENT_FRACTION) & (share <= _MAX_SEGMENT_FRACTION)
            regions = [int(number) for number in numbers[suitable]]
            masks = [labels == number for number in regions]
            boxes = [_as_box(mask_box(mask)) for mask in masks]
        scores = self.score_crops(pixels, boxes, prompt, masks=masks)
        found = [
            Detection(box, score, prompt.strip(), None if regions is None else regions[k])
            for k, (box, score) in enumerate(zip(boxes, scores, strict=True))
        ]
        return sorted(found, key=lambda detection: -detection.score)

    def score_crops(
        self,
        pixels: Pixels,
        boxes: ArrayLike,
        prompt: str,
        *,
        masks: Sequence[Mask] | None = None,
    ) -> list[float]:
        """Return how well each box, or each mask if given, matches `prompt`; see `Detector.score_crops`."""
        corners = [_as_box(box) for box in np.asarray(boxes, np.float64).reshape(-1, 4)]
        if masks is not None and len(masks) != len(corners):
            raise ValueError(f"{len(corners)} boxes and {len(masks)} masks")
        if not corners:
            return []
        return self.score_descriptions(self._vectors(pixels, corners, masks), prompt)

    def describe_crops(self, pixels: Pixels, boxes: ArrayLike, masks: Sequence[Mask]) -> Float32:
        """Return the vectors on white and before blurred surroundings, and `whole_odds`, [n, 2 D + 1].

        See `Detector.describe_crops`.
        """
        corners = [_as_box(box) for box in np.asarray(boxes, np.float64).reshape(-1, 4)]
        whole = self._classifier.whole_odds(self._classifier.describe_crops(pixels, boxes, masks))
        return np.hstack([self._vectors(pixels, corners, masks), whole[:, None]])

    def score_descriptions(self, described: Float32, prompt: str) -> list[float]:
        """Return the probability of the prompt among the words of the vocabulary; see `Detector.score_descriptions`.

        Raises
        ------
        PromptError
            When the prompt is empty or too long.
        """
        vector = self._encoder.of_words(self._asked(prompt)).mean(axis=0, keepdims=True)
        vector /= np.linalg.norm(vector)
        return [float(score) for score in self._scores(described, vector)[:, 0]]

    def _asked(self, prompt: str) -> Sequence[str]:
        """Return the text of a prompt, or the English words for a German or French one where the encoder needs them."""
        text = _required(prompt)
        return [text] if self._encoder.kind.knows_languages else word_list().english_of(text) or [text]

    def score_vocabulary(self, described: Float32) -> Float32:
        """Return the same for each word of `MADE_CLASSES`, [n, V]; see `Detector.score_vocabulary`."""
        made = {word_list().classes[index].words[0] for index in MADE_CLASSES}
        return self._scores(described, self._vocabulary[[word in made for word in self._words]])

    def name_descriptions(self, described: Float32) -> list[tuple[str, float]]:
        """Return the five most probable words of the vocabulary for the object; see `Detector.name_descriptions`."""
        if len(described) == 0:
            return []
        mean = _softmax(self._logits(described)).mean(axis=(0, 1))
        best = np.argsort(-mean, kind="stable")[:_MAX_NAMED]
        return [(self._words[int(index)], float(mean[index])) for index in best]

    def whole_odds(self, described: Float32) -> Float32:
        """Return the last column of the descriptions; see `Detector.whole_odds`."""
        return described[:, -1]

    def _vectors(self, pixels: Pixels, boxes: Sequence[Box], masks: Sequence[Mask] | None) -> Float32:
        """Return the vectors of each crop side by side, [n, D] of boxes or [n, 2 D] of masks."""
        if masks is None:
            return self._encoder.of_pictures([cut_out(pixels, box, None, "white").squared() for box in boxes])
        crops = [
            cut_out(pixels, box, mask, background).squared()
            for box, mask in zip(boxes, masks, strict=True)
            for background in _BACKGROUNDS
        ]
        return self._encoder.of_pictures(crops).reshape(len(boxes), -1)

    @cached_property
    def _vocabulary(self) -> Float32:
        """Vectors of the words of the vocabulary, [V, D]."""
        width = self._encoder.of_words(self._words[:1]).shape[1]
        return kept_vectors(
            self._derived, self._words, self._encoder.of_words, fingerprint=self._encoder.fingerprint, width=width
        )

    def _crops(self, described: Float32) -> Float32:
        """Return the vectors of descriptions, of unit length again where they were kept with 16 bits, [n, crops, D]."""
        width = self._vocabulary.shape[1]
        vectors = described[:, : described.shape[1] // width * width].reshape(len(described), -1, width)
        return np.asarray(vectors / np.linalg.norm(vectors, axis=2, keepdims=True), np.float32)

    def _logits(self, described: Float32) -> Float32:
        """Return the logits of the words of the vocabulary, [n, crops, V]."""
        return np.asarray(_SCALE * self._crops(described) @ self._vocabulary.T, np.float32)

    def _scores(self, described: Float32, vectors: Float32) -> Float32:
        """Return the probability of each of `vectors` [W, D] against words unlike it; the mean of the crops, [n, W]."""
        if len(described) == 0:
            return np.zeros((0, len(vectors)), np.float32)
        against = np.ones((len(self._words), len(vectors)), np.float32)
        np.put_along_axis(against, _nearest(vectors @ self._vocabulary.T).T, 0, axis=0)
        known, asked = self._logits(described), _SCALE * self._crops(described) @ vectors.T
        top = known.max(axis=2, keepdims=True)  # so that no exponential overflows
        others = np.exp(known - top) @ against
        return np.asarray((1 / (1 + others * np.exp(np.minimum(top - asked, 80)))).mean(axis=1), np.float32)


def _nearest(similarity: Float32) -> Int64:
    """Return the columns of the `_N_ALIKE` largest values of each row."""
    return np.argsort(-similarity, axis=1, kind="stable")[:, :_N_ALIKE]


def _softmax(logits: Float32) -> Float32:
    powers = np.exp(logits - logits.max(axis=-1, keepdims=True))
    return np.asarray(powers / powers.sum(axis=-1, keepdims=True), np.float32)


def _required(prompt: str) -> str:
    """Return the prompt without article and punctuation; raises `PromptError` when nothing is left."""
    text = normalised(prompt)
    if not text:
        raise PromptError("The prompt is empty. Type what to look for, for example: vase")
    return text


def _windows(height: int, width: int) -> list[Box]:
    boxes = []
    for count in _WINDOWS:
        side = min(height, width) / count
        rows, columns = (np.arange(0, size - side + 1e-6, side / 2) for size in (height, width))
        boxes += [_as_box((x, y, x + side, y + side)) for y in rows for x in columns]
    return boxes


def _as_box(corners: ArrayLike | None) -> Box:
    x0, y0, x1, y1 = (float(value) for value in np.asarray(corners, np.float64))
    return x0, y0, x1, y1
