"""Map a prompt to classes of the classifier: by equal, heritage or broader words, or by similarity of meaning.

What is a word that pictures taught (`engine.core.words.pictured`) has no class, however near its meaning is to one.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from ...core.arrays import Float32, Int64
from ...core.errors import PromptError
from ...core.words import normalised, pictured, word_list
from .detector import PromptCheck
from .kept_vectors import kept_vectors
from .sentences import SentenceEncoder

N_CLASSES = 1000
# Smallest similarity of a known prompt; calibrated, see docs/design_notes/grounding.md.
_MIN_SIMILARITY = 0.61  # chosen on prompt_words
# Classes whose similarity is this much lower than the best one also match: "clock" is a wall clock and a digital clock.
_SIMILARITY_SPREAD = 0.08  # chosen on prompt_words
# Smallest similarity of a word that is suggested for an unknown prompt; see docs/design_notes/grounding.md.
_MIN_SUGGESTED = 0.55  # chosen on prompt_words
_MAX_NAMED = 5


class Vocabulary:
    """The words of the classes, and the similarity of prompts to them.

    Parameters
    ----------
    derived : Path or None
        Folder in which the vectors of all class words are cached between runs; computing them takes 8 CPU seconds. None
        disables the cache.
    """

    def __init__(self, encoder: SentenceEncoder, derived: Path | None = None) -> None:
        self._encoder = encoder
        self._derived = derived
        self._list = word_list()

    def name(self, index: int) -> str:
        """Return the usual word of a class."""
        return self._list.classes[index].words[0]

    def class_weights(self, prompt: str) -> dict[int, float]:
        """Return the classes that match `prompt` with their similarity, best first; empty if no class matches.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        text = required_text(prompt)
        if pictured(prompt) is not None:
            return {}
        if certain := self._list.classes_of(text):
            return dict.fromkeys(sorted(certain), 1.0)
        similarity = self._similarities(prompt)
        best = float(similarity.max())
        # A misspelt word has no meaning of its own: "tepot" would be a hot pot.
        if best < _MIN_SIMILARITY or self._misspelt(prompt):
            return {}
        matching = np.flatnonzero(similarity >= max(_MIN_SIMILARITY, best - _SIMILARITY_SPREAD))
        return {int(i): float(similarity[i]) for i in matching[np.argsort(-similarity[matching], kind="stable")]}

    def check(self, prompt: str) -> PromptCheck:
        """Return whether `prompt` matches a class, with the matching classes or the nearest words.

        The nearest words are those that are spelt nearly like the prompt, otherwise those that mean nearly the same;
        there may be none.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        class_weights = self.class_weights(prompt)
        if class_weights:
            matches = [(self.name(index), round(similarity, 3)) for index, similarity in class_weights.items()]
            words = ", ".join(word for word, _ in matches[:_MAX_NAMED])
            return PromptCheck(True, matches, f"{prompt.strip()!r} is searched for as: {words}.")
        languages = "whose words are English, some also German and French"
        unknown = f"{prompt.strip()!r} is outside the offline vocabulary, {languages}"
        if pictured(prompt) is not None:
            return PromptCheck(False, [], f"{unknown}, but known from pictures. Click on the object instead.")
        matches = [(word, 1.0) for word in self._misspelt(prompt)]
        misspelt = bool(matches)
        if not misspelt:
            similarities = self._similarities(prompt)
            nearest = np.argsort(-similarities, kind="stable")[:_MAX_NAMED]
            near = [(self.name(int(i)), round(float(similarities[i]), 3)) for i in nearest]
            matches = [(word, similarity) for word, similarity in near if similarity >= _MIN_SUGGESTED]
        if not matches:
            return PromptCheck(False, [], f"{unknown}. Use another word, or click on the object instead.")
        words = ", ".join(word for word, _ in matches)
        return PromptCheck(
            False,
            matches,
            f"{unknown}; the nearest words are: {words}. Use one of them if it fits, or click on the object instead.",
            misspelt,
        )

    def _misspelt(self, prompt: str) -> list[str]:
        """Return words that are spelt nearly like the prompt; none if all its own words are English ones."""
        return self._list.misspelt(required_text(prompt), self._encoder.knows)

    def _similarities(self, prompt: str) -> Float32:
        """Return the similarity to each class, shape [1000]: the mean over its best word and its definition.

        See docs/design_notes/grounding.md for why the definition is included.
        """
        vector = self._encoder.encode([required_text(prompt)])[0]
        words, definitions, class_of_word = self._vectors
        best = np.full(N_CLASSES, -1.0, np.float32)
        np.maximum.at(best, class_of_word, words @ vector)
        return np.asarray((best + definitions @ vector) / 2, np.float32)

    @cached_property
    def _vectors(self) -> tuple[Float32, Float32, Int64]:
        """Vectors of all words, vectors of the definitions, and the class of each word."""
        words = [word for entry in self._list.classes for word in entry.words]
        class_of_word = np.array([index for index, entry in enumerate(self._list.classes) for _ in entry.words])
        definitions = [f"{', '.join(entry.words)}: {entry.definition}" for entry in self._list.classes]
        vectors = kept_vectors(
            self._derived, words + definitions, self._encoder.encode,
            fingerprint=self._encoder.fingerprint, width=self._encoder.width,
        )  # fmt: skip
        return vectors[: len(words)], vectors[len(words) :], class_of_word


def required_text(prompt: str) -> str:
    """Return a prompt as `normalised` does.

    Raises
    ------
    PromptError
        When nothing is left of it.
    """
    text = normalised(prompt)
    if not text:
        raise PromptError("The prompt is empty. Type what to look for, for example: vase")
    return text
