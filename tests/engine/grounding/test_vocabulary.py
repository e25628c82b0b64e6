"""Prompts are understood, or refused with the nearest words."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.errors import PromptError
from engine.grounding.offline_vocabulary import OfflineVocabulary
from engine.grounding.sentences import SentenceEncoder
from engine.grounding.vocabulary import N_CLASSES, Vocabulary, read_class_words


def test_there_are_a_thousand_classes_in_the_classifiers_order() -> None:
    words = read_class_words()
    assert len(words) == N_CLASSES
    assert words[0][0] == "tench" and words[883] == ("vase",) and words[999][0] == "toilet tissue"


@pytest.mark.parametrize(
    ("prompt", "meant"),
    [
        ("vase", "vase"),
        ("Vases", "vase"),
        ("a Greek vase, with two handles", "vase"),
        ("amphora", "vase"),
        ("tea pot", "teapot"),
        ("sandglass", "hourglass"),
        ("chalice", "goblet"),
        ("round shield", "shield"),
        ("church bell", "chime"),
        ("flower pots", "pot"),
        ("a mask of a warrior", "mask"),
        ("bananas", "banana"),
        ("tribal mask", "mask"),
        ("acoustic guitars", "acoustic guitar"),
    ],
)
def test_known_words_are_taken_for_what_they_mean(detector: OfflineVocabulary, prompt: str, meant: str) -> None:
    check = detector.knows(prompt)
    assert check.known and check.matches[0][0] == meant
    assert "is looked for as" in check.message


@pytest.mark.parametrize(
    "prompt",
    ["spaceship engine", "sarcophagus", "xylograph", "quantum flux", "cuneiform tablet", "bust", "asdfgh", "花瓶"],
)
def test_prompt_outside_the_vocabulary_is_refused_with_the_nearest_words(
    detector: OfflineVocabulary, prompt: str
) -> None:
    check = detector.knows(prompt)
    assert not check.known and len(check.matches) == 5
    assert "outside what the offline vocabulary knows" in check.message and check.matches[0][0] in check.message
    likeness = [value for _, value in check.matches]
    assert likeness == sorted(likeness, reverse=True)


@pytest.mark.parametrize("prompt", ["", "   ", "!?", "_"])
def test_empty_prompt_says_what_to_type(detector: OfflineVocabulary, prompt: str) -> None:
    with pytest.raises(PromptError, match="prompt is empty"):
        detector.knows(prompt)


class _FewCalls:
    """A sentence encoder that may not be asked for more than single prompts."""

    def __init__(self, encoder: SentenceEncoder) -> None:
        self._encoder, self.width, self.fingerprint = encoder, encoder.width, encoder.fingerprint
        self.long_calls = 0

    def encode(self, texts: list[str]) -> object:
        self.long_calls += len(texts) > 1
        return self._encoder.encode(texts[:1]).repeat(len(texts), axis=0)


def test_vectors_of_the_classes_are_kept_between_runs_and_made_anew_when_damaged(
    encoder: SentenceEncoder, tmp_path: Path
) -> None:
    counting = _FewCalls(encoder)
    for _ in range(2):
        Vocabulary(counting, tmp_path).check("quantum flux")  # type: ignore[arg-type]
    assert counting.long_calls == 1
    (file,) = tmp_path.iterdir()
    file.write_bytes(b"half")
    Vocabulary(counting, tmp_path).check("quantum flux")  # type: ignore[arg-type]
    assert counting.long_calls == 2
