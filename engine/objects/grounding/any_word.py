"""A text detector for any words: an image-text encoder that describes the crops of what may be objects.

Nothing here was fitted to the weights of an encoder. A word is compared with the words of the vocabulary, and
refused by the scores of these, see `engine.objects.looks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import softmax

from ...core.arrays import Float32, Int64, Mask, Pixels, normalized
from ...core.words import MADE_CLASSES, word_list
from .crop_describer import CropDescriber, as_boxes
from .crops import Background, Box, cut_out
from .detector import PromptCheck
from .image_text import ImageTextEncoder
from .kept_vectors import kept_vectors
from .offline_vocabulary import OfflineVocabulary
from .vocabulary import required_text

_BACKGROUNDS: tuple[Background, ...] = ("white", "blurred")
"""Treatments of the surroundings of a crop; each is described on its own."""
_SCALE = 100.0  # Radford et al. 2021
"""Factor of a cosine that gives a logit."""
_N_ALIKE = 5
"""Words of the vocabulary, the nearest by meaning, that do not speak against a word: *vase* not against *amphora*. Not
fitted; it acts on all words alike, so that no share of refused words depends on it."""
_MAX_NAMED = 5


class AnyWord(CropDescriber):
    """An image-text encoder for pictures and words, and the offline vocabulary for how whole a crop looks.

    Parameters
    ----------
    derived : Path or None
        Folder of the vectors of the vocabulary, which are kept between runs; None keeps none.
    """

    def __init__(self, encoder: ImageTextEncoder, classifier: OfflineVocabulary, derived: Path | None) -> None:
        self.name = encoder.name
        self.fingerprint = f"{encoder.fingerprint}, examples 1"
        self._encoder, self._classifier, self._derived = encoder, classifier, derived
        # Different birds are called crane.
        self._words = list(dict.fromkeys(entry.words[0] for entry in word_list().classes))

    def check_prompt(self, prompt: str) -> PromptCheck:
        """Return that the detector can look for `prompt`: it accepts any words; raises `PromptError` for none."""
        required_text(prompt)
        return PromptCheck(True, [], f"{self.name} looks for any words.")

    def describe_crops(self, pixels: Pixels, boxes: ArrayLike, masks: Sequence[Mask]) -> Float32:
        """Return the vectors on white and before blurred surroundings, and `whole_odds`, [n, 2 D + 1].

        See `Detector.describe_crops`.
        """
        whole = self._classifier.whole_odds(self._classifier.describe_crops(pixels, boxes, masks))
        return np.hstack([self.describe_segments(pixels, as_boxes(boxes), masks), whole[:, None]])

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
        text = required_text(prompt)
        return [text] if self._encoder.kind.knows_languages else word_list().english_of(text) or [text]

    def score_vocabulary(self, described: Float32) -> Float32:
        """Return the same for each word of `MADE_CLASSES`, [n, V]; see `Detector.score_vocabulary`."""
        made = {word_list().classes[index].words[0] for index in MADE_CLASSES}
        return self._scores(described, self._vocabulary[[word in made for word in self._words]])

    def name_descriptions(self, described: Float32) -> list[tuple[str, float]]:
        """Return the five most probable words of the vocabulary for the object; see `Detector.name_descriptions`."""
        if len(described) == 0:
            return []
        mean = softmax(self._logits(described), axis=2).mean(axis=(0, 1))
        best = np.argsort(-mean, kind="stable")[:_MAX_NAMED]
        return [(self._words[int(index)], float(mean[index])) for index in best]

    def example_vectors(self, described: Float32) -> Float32:
        """Return the vectors of the crops, [n, 2 D]; see `Detector.example_vectors`."""
        return described[:, :-1]

    def usual_example(self) -> None:
        """Return None: no encoder's weights could be run here."""
        return None

    def whole_odds(self, described: Float32) -> Float32:
        """Return the last column of the descriptions; see `Detector.whole_odds`."""
        return described[:, -1]

    def describe_segments(self, pixels: Pixels, boxes: Sequence[Box], masks: Sequence[Mask]) -> Float32:
        """Return the vectors of `describe_crops`, [n, 2 D]."""
        if not boxes:
            return np.zeros((0, 1), np.float32)
        crops = [
            cut_out(pixels, box, mask, background).squared()
            for box, mask in zip(boxes, masks, strict=True)
            for background in _BACKGROUNDS
        ]
        return self._encoder.of_pictures(crops).reshape(len(boxes), -1)

    def word_for(self, row: Float32, prompt: str) -> str:
        """Return the prompt."""
        return prompt.strip()

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
        return normalized(vectors)

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
