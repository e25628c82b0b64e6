"""What the engine says is shown in the language of the user."""

from __future__ import annotations

import pytest

from engine.core.language import Language, languages

ENGLISH, GERMAN = languages()


@pytest.mark.parametrize(
    ("sentence", "own"),
    [
        ("step 500 of 3000", "Schritt 500 von 3000"),
        ("Segments of a [1].jpg", "Segmente von a [1].jpg"),
        ("Looking for 'vase' (vocabulary)", "'vase' wird gesucht (vocabulary)"),
        ("Isolate", "Freistellen"),
        ("Vase {blue} is not here.", "Vase {blue} is not here."),
    ],
)
def test_sentence_of_the_engine_keeps_its_values(sentence: str, own: str) -> None:
    assert GERMAN.said(sentence) == own
    assert ENGLISH.said(sentence) == sentence


def test_longest_form_that_fits_is_taken() -> None:
    forms = {"step {} of {}": "kurz {} {}", "step {} of {}, trying colours": "lang {} {}"}
    assert Language("xx", "X", (), {}, forms).said("step 1 of 2, trying colours") == "lang 1 2"


def test_text_without_a_translation_stays_english() -> None:
    assert GERMAN.translated("{} of {} unknown", 1, 2) == "1 of 2 unknown"
