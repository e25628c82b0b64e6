"""Map a prompt to classes of the classifier: by equal, heritage or broader words, or by similarity of meaning."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, PromptError
from ..files import ArraySpec, atomic_write, read_array, read_text
from ..project_folder import stage_key
from .detector import PromptCheck
from .sentences import SentenceEncoder

__all__ = ["N_CLASSES", "Vocabulary", "read_class_words"]

N_CLASSES = 1000  # by definition
_HERE = Path(__file__).parent
# Smallest similarity of a known prompt; calibrated, see docs/design_notes/grounding.md.
_MIN_SIMILARITY = 0.61  # chosen on prompt_words
# Classes whose similarity is this much lower than the best one also match: "clock" is a wall clock and a digital clock.
_SIMILARITY_SPREAD = 0.08  # chosen on prompt_words
_N_NEAREST = 5  # by definition
_ARTICLES = re.compile(r"^(?:a|an|the|some|this|that|my|our)\s+")
_AFTER_NOUN = re.compile(r"\s+(?:of|with|in|on|from|for|by|at|near|under|behind|without|made|showing)\s+.*$")


@dataclass(frozen=True)
class _ClassWords:
    words: tuple[str, ...]
    definition: str


def _read_rows(file: Path) -> list[list[str]]:
    text = read_text(file, advice="Install the engine again.")
    return [line.split("\t") for line in text.splitlines() if line and not line.startswith("#")]


def read_class_words() -> list[tuple[str, ...]]:
    """Return the words of each class, in the order of the classifier's outputs; the usual word of a class is first."""
    return [entry.words for entry in _read_classes()]


def _read_classes() -> list[_ClassWords]:
    rows = _read_rows(_HERE / "imagenet_classes.txt")
    return [_ClassWords(tuple(words.split(", ")), definition) for _, words, definition in rows]


class Vocabulary:
    """The words of the classes, and the similarity of prompts to them.

    Parameters
    ----------
    encoder : SentenceEncoder
    derived : Path or None
        Folder in which the vectors of all class words are cached between runs; computing them takes 8 CPU seconds. None
        disables the cache.
    """

    def __init__(self, encoder: SentenceEncoder, derived: Path | None = None) -> None:
        self._encoder = encoder
        self._derived = derived
        self._classes = _read_classes()
        self._classes_of_word: dict[str, set[int]] = {}
        for index, entry in enumerate(self._classes):
            for word in entry.words:
                self._classes_of_word.setdefault(word.lower(), set()).add(index)
        for word, synonyms in _read_rows(_HERE / "heritage_words.txt"):
            indices = set().union(*(self._classes_of_word[synonym] for synonym in synonyms.split(", ")))
            self._classes_of_word.setdefault(word, set()).update(indices)
        for word, spans in _read_rows(_HERE / "broader_words.txt"):
            ends = [span.partition("-") for span in spans.split()]
            self._classes_of_word[word] = {
                k for first, _, last in ends for k in range(int(first), int(last or first) + 1)
            }

    def name(self, index: int) -> str:
        """Return the usual word of a class."""
        return self._classes[index].words[0]

    def class_weights(self, prompt: str) -> dict[int, float]:
        """Return the classes that match `prompt` with their similarity, best first; empty if no class matches.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        certain = self._classes_by_word(prompt)
        if certain:
            return dict.fromkeys(sorted(certain), 1.0)
        similarity = self._similarities(prompt)
        best = float(similarity.max())
        if best < _MIN_SIMILARITY:
            return {}
        matching = np.flatnonzero(similarity >= max(_MIN_SIMILARITY, best - _SIMILARITY_SPREAD))
        return {int(i): float(similarity[i]) for i in matching[np.argsort(-similarity[matching], kind="stable")]}

    def check(self, prompt: str) -> PromptCheck:
        """Return whether `prompt` matches a class, with the matching classes or the nearest ones.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        class_weights = self.class_weights(prompt)
        if class_weights:
            matches = [(self.name(index), round(similarity, 3)) for index, similarity in class_weights.items()]
            words = ", ".join(word for word, _ in matches[:_N_NEAREST])
            return PromptCheck(True, matches, f"{prompt.strip()!r} is searched for as: {words}.")
        similarities = self._similarities(prompt)
        nearest = np.argsort(-similarities, kind="stable")[:_N_NEAREST]
        matches = [(self.name(int(i)), round(float(similarities[i]), 3)) for i in nearest]
        words = ", ".join(word for word, _ in matches)
        return PromptCheck(
            False,
            matches,
            f"{prompt.strip()!r} is outside the offline vocabulary; the nearest words are: {words}. Use one of them if "
            "it fits, or click on the object instead.",
        )

    def _classes_by_word(self, prompt: str) -> set[int]:
        """Return the classes with a word equal to the prompt, its singular, or its noun ("a red vase with handles")."""
        text = _normalise(prompt)
        noun = _AFTER_NOUN.sub("", text)
        words = noun.split()
        # The longest ending is tried first: "church bell" is a heritage word and must have priority over "bell".
        endings = [text, *(" ".join(words[i:]) for i in range(len(words)))]
        for ending in endings:
            # Words are also joined: "tea pot" is a teapot, not a pot.
            for form in (*_singulars(ending), *_singulars(ending.replace(" ", ""))):
                if form in self._classes_of_word:
                    return self._classes_of_word[form]
        return set()

    def _similarities(self, prompt: str) -> NDArray[np.float32]:
        """Return the similarity to each class, shape [1000]: the mean over its best word and its definition.

        See docs/design_notes/grounding.md for why the definition is included.
        """
        vector = self._encoder.encode([_normalise(prompt)])[0]
        words, definitions, class_of_word = self._vectors
        best = np.full(N_CLASSES, -1.0, np.float32)
        np.maximum.at(best, class_of_word, words @ vector)
        return np.asarray((best + definitions @ vector) / 2, np.float32)

    @cached_property
    def _vectors(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
        """Vectors of all words, vectors of the definitions, and the class of each word."""
        words = [word for entry in self._classes for word in entry.words]
        class_of_word = np.array([index for index, entry in enumerate(self._classes) for _ in entry.words])
        definitions = [f"{', '.join(entry.words)}: {entry.definition}" for entry in self._classes]
        vectors = self._encode_cached(words + definitions)
        return vectors[: len(words)], vectors[len(words) :], class_of_word

    def _encode_cached(self, texts: list[str]) -> NDArray[np.float32]:
        file = None
        if self._derived is not None:
            file = self._derived / f"class-words-{stage_key(texts, self._encoder.fingerprint)[:16]}.npy"
            spec = ArraySpec("float32", (len(texts), self._encoder.width), finite=True)
            try:
                return read_array(file, spec, advice="It is computed again.")
            except FormatError:
                pass  # missing or damaged: computed again below, and replaced
        # Texts of similar length are encoded together, because padding would otherwise cost more than the words.
        order = np.argsort([len(text) for text in texts], kind="stable")
        vectors = np.empty((len(texts), self._encoder.width), np.float32)
        vectors[order] = self._encoder.encode([texts[i] for i in order])
        if file is not None:
            with atomic_write(file) as stream:
                np.save(stream, vectors)
        return vectors


def _normalise(prompt: str) -> str:
    """Return the prompt in lower case, without articles and punctuation."""
    text = re.sub(r"[^\w\s'-]", " ", prompt.lower()).replace("_", " ")
    text = _ARTICLES.sub("", " ".join(text.split()))
    if not any(character.isalnum() for character in text):
        raise PromptError("The prompt is empty. Type what to look for, for example: vase")
    return text


def _singulars(text: str) -> list[str]:
    """Return `text` and the words that it may be the plural of."""
    forms = [text]
    if text.endswith("ies"):
        forms.append(text[:-3] + "y")
    if text.endswith("es"):
        forms.append(text[:-2])
    if text.endswith("s") and not text.endswith("ss"):
        forms.append(text[:-1])
    return forms
