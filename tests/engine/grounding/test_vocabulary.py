"""Prompts match classes, or are rejected with the nearest words."""

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
    ("prompt", "expected"),
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
        ("horse", "sorrel"),
        ("motorcycle", "moped"),
    ],
)
def test_known_words_match_their_class(detector: OfflineVocabulary, prompt: str, expected: str) -> None:
    check = detector.check_prompt(prompt)
    assert check.known and check.matches[0][0] == expected
    assert "is searched for as" in check.message


def test_broader_word_matches_all_its_classes_and_no_word_of_a_class_is_one(detector: OfflineVocabulary) -> None:
    chairs = {match for match, _ in detector.check_prompt("a wooden chair").matches}
    assert {"barber chair", "folding chair", "rocking chair", "throne"} == chairs
    assert [match for match, _ in detector.check_prompt("plate").matches] == ["plate"]


@pytest.mark.parametrize(
    "prompt",
    ["spaceship engine", "sarcophagus", "xylograph", "quantum flux", "cuneiform tablet", "bust", "asdfgh", "花瓶"],
)
def test_prompt_outside_the_vocabulary_is_rejected_with_the_nearest_words(
    detector: OfflineVocabulary, prompt: str
) -> None:
    check = detector.check_prompt(prompt)
    assert not check.known and len(check.matches) == 5
    assert "outside the offline vocabulary" in check.message and check.matches[0][0] in check.message
    similarities = [value for _, value in check.matches]
    assert similarities == sorted(similarities, reverse=True)


@pytest.mark.parametrize("prompt", ["", "   ", "!?", "_"])
def test_empty_prompt_says_what_to_type(detector: OfflineVocabulary, prompt: str) -> None:
    with pytest.raises(PromptError, match="prompt is empty"):
        detector.check_prompt(prompt)


class _CountingEncoder:
    """A sentence encoder that counts the calls with more than one text."""

    def __init__(self, encoder: SentenceEncoder) -> None:
        self._encoder, self.width, self.fingerprint = encoder, encoder.width, encoder.fingerprint
        self.long_calls = 0

    def encode(self, texts: list[str]) -> object:
        self.long_calls += len(texts) > 1
        return self._encoder.encode(texts[:1]).repeat(len(texts), axis=0)


def test_vectors_of_the_classes_are_cached_and_computed_again_when_damaged(
    encoder: SentenceEncoder, tmp_path: Path
) -> None:
    counting = _CountingEncoder(encoder)
    for _ in range(2):
        Vocabulary(counting, tmp_path).check("quantum flux")  # type: ignore[arg-type]
    assert counting.long_calls == 1
    (file,) = tmp_path.iterdir()
    file.write_bytes(b"half")
    Vocabulary(counting, tmp_path).check("quantum flux")  # type: ignore[arg-type]
    assert counting.long_calls == 2
