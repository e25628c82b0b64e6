"""Prompts match classes, or are rejected with the nearest words."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.core.errors import PromptError
from engine.core.words import word_list
from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from engine.objects.grounding.sentences import SentenceEncoder
from engine.objects.grounding.vocabulary import N_CLASSES, Vocabulary


def test_there_are_a_thousand_classes_in_the_classifiers_order() -> None:
    words = [entry.words for entry in word_list().classes]
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


@pytest.mark.parametrize(
    ("word", "classes"),
    [
        ("a desk lamp", {"table lamp", "lampshade", "candle", "jack-o'-lantern", "spotlight"}),
        ("plants", {"pot", "daisy", "yellow lady's slipper"}),
        ("sneakers", {"running shoe"}),
        ("biplane", {"airliner", "warplane"}),
    ],
)
def test_a_word_of_the_home_means_the_thing_and_not_its_first_sense(word: str, classes: set[str]) -> None:
    words = word_list()
    assert {words.classes[index].words[0] for index in words.classes_of(word)} == classes


def test_broader_word_matches_all_its_classes_and_no_word_of_a_class_is_one(detector: OfflineVocabulary) -> None:
    chairs = {match for match, _ in detector.check_prompt("a wooden chair").matches}
    assert {"barber chair", "folding chair", "rocking chair", "throne"} == chairs
    assert [match for match, _ in detector.check_prompt("plate").matches] == ["plate"]


@pytest.mark.parametrize(
    "prompt",
    ["sarcophagus", "xylograph", "quantum flux", "cuneiform tablet", "bust", "asdfgh", "花瓶", "Büchereiregalbretter"],
)
def test_prompt_far_from_the_vocabulary_suggests_nothing_and_says_which_languages_it_has(
    detector: OfflineVocabulary, prompt: str
) -> None:
    check = detector.check_prompt(prompt)
    assert not check.known and check.matches == []
    assert check.message == (
        f"{prompt!r} is outside the offline vocabulary, whose words are English, some also German and French. Use "
        "another word, or click on the object instead."
    )


@pytest.mark.parametrize(
    ("prompt", "expected"),
    [
        ("teekane", "Teekanne"), ("spiegl", "Spiegel"),
        ("vaze", "vase"), ("a blue vaze", "vase"), ("tepot", "teapot"), ("avse", "vase"), ("obelsik", "obelisk"),
        ("gobelts", "goblet"), ("amfora", "amphora"), ("sheild", "shield"), ("hourglas with sand", "hourglass"),
    ],
)  # fmt: skip
def test_misspelt_prompt_suggests_the_word_that_is_spelt_like_it(
    detector: OfflineVocabulary, prompt: str, expected: str
) -> None:
    check = detector.check_prompt(prompt)
    assert not check.known and check.matches[0][0] == expected and len(check.matches) <= 3
    assert f"the nearest words are: {expected}" in check.message and "English" in check.message


@pytest.mark.parametrize(
    ("prompt", "expected"),
    [
        ("Gitarre", "acoustic guitar"), ("GITARREN", "acoustic guitar"), ("eine rote Gitarre", "acoustic guitar"),
        ("Teekanne", "teapot"), ("Teekannen aus Porzellan", "teapot"), ("die Trommel", "drum"), ("Kruege", "pitcher"),
        ("théière", "teapot"), ("theieres", "teapot"), ("une guitare bleue", "acoustic guitar"),
        ("l'horloge", "analog clock"), ("cruche en terre cuite", "pitcher"), ("masque", "mask"),
        ("Obelisken", "obelisk"), ("Spiegel", "car mirror"),
    ],
)  # fmt: skip
def test_german_and_french_names_are_searched_for_as_the_things_that_they_name(
    detector: OfflineVocabulary, prompt: str, expected: str
) -> None:
    check = detector.check_prompt(prompt)
    assert check.known and check.matches[0][0] == expected
    assert all(similarity == 1 for _, similarity in check.matches) and "is searched for as" in check.message


@pytest.mark.parametrize(
    "prompt", ["fibula", "stele", "brooch", "tankard", "sword", "halberd", "gift", "rock", "hose", "chat", "relief"]
)
def test_english_word_is_not_taken_for_a_german_or_french_one(prompt: str) -> None:
    assert word_list().english_of(prompt) == ()


def test_unknown_english_word_suggests_what_means_nearly_the_same_and_not_what_is_spelt_like_it(
    detector: OfflineVocabulary,
) -> None:
    words = [word for word, _ in detector.check_prompt("spaceship engine").matches]
    assert words == ["speedboat", "space shuttle"]
    assert "bus" not in detector.check_prompt("bust").message.split()


def test_phrase_that_holds_and_is_one_word_and_a_quoted_list_is_all_its_words(detector: OfflineVocabulary) -> None:
    assert [word for word, _ in detector.check_prompt("Salt & pepper shakers").matches] == ["saltshaker"]
    assert {word for word, _ in detector.check_prompt("vase and teapot").matches} == {"vase", "teapot"}
    assert [word for word, _ in detector.check_prompt("a blue and white vase").matches] == ["vase"]


@pytest.mark.parametrize("prompt", ["", "   ", "!?", "_"])
def test_empty_prompt_says_what_to_type(detector: OfflineVocabulary, prompt: str) -> None:
    with pytest.raises(PromptError, match="prompt is empty"):
        detector.check_prompt(prompt)


class _CountingEncoder:
    """A sentence encoder that counts the calls with more than one text."""

    def __init__(self, encoder: SentenceEncoder) -> None:
        self._encoder, self.width, self.fingerprint = encoder, encoder.width, encoder.fingerprint
        self.knows = encoder.knows
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
