"""Words that pictures taught are known in English, German and French, and none of them is a word of a class."""

from __future__ import annotations

import numpy as np
import pytest

from engine.core.words import picture_words, pictured, word_list
from engine.core.words.vocabulary_words import PICTURE_WORDS_FILE
from engine.objects.grounding.pictures import FEATURES_FILE


def _rows() -> list[list[str]]:
    lines = PICTURE_WORDS_FILE.read_text(encoding="utf-8").splitlines()
    return [line.split("\t") for line in lines if not line.startswith("#")]


def test_each_word_has_a_number_of_its_own_and_features_and_is_no_word_of_a_class() -> None:
    known = picture_words()
    assert len(known.classes) == len(_rows()) > 150
    for number, (words, names, pictures) in enumerate(_rows()):
        assert {known.classes_of_word[word] for word in words.split(", ")} == {frozenset({number})}, words
        assert not [word for word in words.split(", ") if word in word_list().classes_of_word]
        assert not [name for name in names.split("; ") if name in word_list().foreign]
        assert pictures.split(), words
    features = np.load(FEATURES_FILE)
    assert features.shape == (len(known.classes), 2560) and (np.abs(features).max(axis=1) == 127).all()


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("key", "key"), ("the key", "key"), ("Keys", "key"), ("Schlüssel", "key"), ("une clé", "key"),
        ("Koffer", "suitcase"), ("valises", "suitcase"), ("sunflowers", "sunflower"),
        ("scissors", "scissors"), ("Schere", "scissors"), ("der Totenkopf", "skull"),
        ("tombstone", "gravestone"), ("pinecone", "pine cone"), ("Leiter", "ladder"), ("l’ancre", "anchor"),
        ("Kuerbis", "pumpkin"), ("une pomme de pin", "pine cone"), ("fire extinguishers", "fire extinguisher"),
    ],
)  # fmt: skip
def test_word_that_only_pictures_teach_is_known_in_three_languages(text: str, word: str) -> None:
    number = pictured(text)
    assert number is not None and picture_words().classes[number].words[0] == word


def test_every_word_with_its_plural_and_every_foreign_name_is_known_from_pictures() -> None:
    for number, (words, names, _) in enumerate(_rows()):
        english = words.split(", ")
        plurals = [f"{word}s" for word in english if not word.endswith("s")]
        for text in [*english, *plurals, *filter(None, names.split("; "))]:
            assert pictured(text) == number, text


@pytest.mark.parametrize(
    "text",
    ["cake stand", "key ring", "tree stump", "book stand", "olive oil", "egg cup", "Schlüsselbrett", "clé de sol",
     "Eis", "Drachen", "vase", "Vase", "crowned crane", "sarcophagus"],
)  # fmt: skip
def test_no_other_text_is_known_from_pictures(text: str) -> None:
    assert pictured(text) is None
