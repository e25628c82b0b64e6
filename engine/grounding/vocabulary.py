"""From a person's words to classes of the classifier: same word, curators' word, or likeness of meaning."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import PromptError
from ..project_folder import atomic_write, stage_key
from .detector import PromptCheck
from .sentences import SentenceEncoder

__all__ = ["N_CLASSES", "Vocabulary", "read_class_words"]

N_CLASSES = 1000
_HERE = Path(__file__).parent
# Calibrated on 50 words that a class fits and 48 that none fits: 0.61 keeps 88 % of the former and refuses 91 % of
# the latter by likeness alone (same words and curators' words, which are certain, come before it).
_KNOWN = 0.61
# Classes this much less alike than the best still count: "clock" is a wall clock and a digital clock.
_SPREAD = 0.08
_N_NEAREST = 5
_ARTICLES = re.compile(r"^(?:a|an|the|some|this|that|my|our)\s+")
_AFTER_NOUN = re.compile(r"\s+(?:of|with|in|on|from|for|by|at|near|under|behind|without|made|showing)\s+.*$")


@dataclass(frozen=True)
class _ClassWords:
    words: tuple[str, ...]
    definition: str


def _lines(file: Path) -> list[list[str]]:
    text = file.read_text(encoding="utf-8")
    return [line.split("\t") for line in text.splitlines() if line and not line.startswith("#")]


def read_class_words() -> list[tuple[str, ...]]:
    """Return the words of each class, in the order of the classifier's outputs, the usual one first."""
    return [entry.words for entry in _read_classes()]


def _read_classes() -> list[_ClassWords]:
    lines = _lines(_HERE / "imagenet_classes.txt")
    return [_ClassWords(tuple(words.split(", ")), definition) for _, words, definition in lines]


class Vocabulary:
    """The classes and how near a prompt comes to each.

    Parameters
    ----------
    encoder : SentenceEncoder
    derived : Path or None
        Folder where the vectors of all class words are kept between runs (8 CPU seconds the first time); None
        keeps nothing.
    """

    def __init__(self, encoder: SentenceEncoder, derived: Path | None = None) -> None:
        self._encoder = encoder
        self._derived = derived
        self._classes = _read_classes()
        self._known_words: dict[str, set[int]] = {}
        for number, entry in enumerate(self._classes):
            for word in entry.words:
                self._known_words.setdefault(word.lower(), set()).add(number)
        for word, meant in _lines(_HERE / "heritage_words.txt"):
            numbers = set().union(*(self._known_words[name] for name in meant.split(", ")))
            self._known_words.setdefault(word, set()).update(numbers)

    def name(self, number: int) -> str:
        """Return the usual word of a class."""
        return self._classes[number].words[0]

    def weights(self, prompt: str) -> dict[int, float]:
        """Return the classes that `prompt` means with their likeness, best first; empty when it means none.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        certain = self._same_word(prompt)
        if certain:
            return dict.fromkeys(sorted(certain), 1.0)
        likeness = self._likeness(prompt)
        best = float(likeness.max())
        if best < _KNOWN:
            return {}
        chosen = np.flatnonzero(likeness >= max(_KNOWN, best - _SPREAD))
        return {int(i): float(likeness[i]) for i in chosen[np.argsort(-likeness[chosen], kind="stable")]}

    def check(self, prompt: str) -> PromptCheck:
        """Return whether `prompt` means a class, and which; or the nearest ones.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        weights = self.weights(prompt)
        if weights:
            matches = [(self.name(number), round(likeness, 3)) for number, likeness in weights.items()]
            words = ", ".join(word for word, _ in matches[:_N_NEAREST])
            return PromptCheck(True, matches, f"{prompt.strip()!r} is looked for as: {words}.")
        likeness = self._likeness(prompt)
        nearest = np.argsort(-likeness, kind="stable")[:_N_NEAREST]
        matches = [(self.name(int(i)), round(float(likeness[i]), 3)) for i in nearest]
        words = ", ".join(word for word, _ in matches)
        return PromptCheck(
            False,
            matches,
            f"{prompt.strip()!r} is outside what the offline vocabulary knows; the nearest words are: {words}. "
            "Use one of them if it fits, or click on the object instead.",
        )

    def _same_word(self, prompt: str) -> set[int]:
        """Classes one of whose words is the prompt, its singular, or its noun ("a red vase with handles")."""
        text = _normal(prompt)
        noun = _AFTER_NOUN.sub("", text)
        words = noun.split()
        # "church bell" is a curators' word and must win over "bell", so the longest ending comes first.
        endings = [text, *(" ".join(words[i:]) for i in range(len(words)))]
        for ending in endings:
            # "tea pot" is a teapot, not a pot.
            for form in (*_singulars(ending), *_singulars(ending.replace(" ", ""))):
                if form in self._known_words:
                    return self._known_words[form]
        return set()

    def _likeness(self, prompt: str) -> NDArray[np.float32]:
        """Mean of the likeness to a class's best word and to its definition, shape [1000].

        The word alone takes "rock" for "rocker" and "bust" for "bustard": MiniLM reads rare words by their
        spelling. The definition does not.
        """
        vector = self._encoder.encode([_normal(prompt)])[0]
        words, definitions, owner = self._vectors
        best = np.full(N_CLASSES, -1.0, np.float32)
        np.maximum.at(best, owner, words @ vector)
        return np.asarray((best + definitions @ vector) / 2, np.float32)

    @cached_property
    def _vectors(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
        words = [word for entry in self._classes for word in entry.words]
        owner = np.array([number for number, entry in enumerate(self._classes) for _ in entry.words])
        definitions = [f"{', '.join(entry.words)}: {entry.definition}" for entry in self._classes]
        vectors = self._kept(words + definitions)
        return vectors[: len(words)], vectors[len(words) :], owner

    def _kept(self, texts: list[str]) -> NDArray[np.float32]:
        file = None
        if self._derived is not None:
            file = self._derived / f"class-words-{stage_key(texts, self._encoder.fingerprint)[:16]}.npy"
            if file.is_file():
                try:
                    vectors = np.load(file, allow_pickle=False)
                    if vectors.shape == (len(texts), self._encoder.width):
                        return np.asarray(vectors, np.float32)
                except (OSError, ValueError, EOFError):
                    file.unlink(missing_ok=True)  # it is derived: making it anew is the cure
        # Texts of like length together: padding would otherwise cost more than the words.
        order = np.argsort([len(text) for text in texts], kind="stable")
        vectors = np.empty((len(texts), self._encoder.width), np.float32)
        vectors[order] = self._encoder.encode([texts[i] for i in order])
        if file is not None:
            with atomic_write(file) as stream:
                np.save(stream, vectors)
        return vectors


def _normal(prompt: str) -> str:
    text = re.sub(r"[^\w\s'-]", " ", prompt.lower()).replace("_", " ")
    text = _ARTICLES.sub("", " ".join(text.split()))
    if not any(character.isalnum() for character in text):
        raise PromptError("The prompt is empty. Type what to look for, for example: vase")
    return text


def _singulars(text: str) -> list[str]:
    """`text` and what it may be the plural of."""
    forms = [text]
    if text.endswith("ies"):
        forms.append(text[:-3] + "y")
    if text.endswith("es"):
        forms.append(text[:-2])
    if text.endswith("s") and not text.endswith("ss"):
        forms.append(text[:-1])
    return forms
