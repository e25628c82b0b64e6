"""What the engine says is shown in the language of the user."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from engine.core.language import Language, languages
from tests.conftest import PATIENCE

ENGLISH, GERMAN = languages()
PAGE = Path(__file__).resolve().parents[4] / "engine" / "serve" / "page" / "src" / "language.js"


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


def test_whole_text_is_taken_before_a_form_that_fits_it() -> None:
    language = Language("xx", "X", (), {"view of the photos": "Bild"}, {"{} of {}": "{} von {}"})
    assert language.said("view of the photos") == "Bild" and language.said("view of a photo") == "view von a photo"


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node")
def test_page_says_every_sentence_as_reports_and_blender_do() -> None:
    sentences = [*GERMAN.texts, *(form.replace("{}", value) for form in GERMAN.sentences for value in ("7", "a\nb"))]
    program = (
        f"import {{ speak, said }} from {json.dumps(PAGE.as_uri())};"
        "import { readFileSync } from 'node:fs';"
        "globalThis.document = { documentElement: {} };"
        "const [table, sentences] = JSON.parse(readFileSync(0, 'utf8'));"
        "speak('de', table); console.log(JSON.stringify(sentences.map(said)));"
    )
    table = {"texts": dict(GERMAN.texts), "sentences": dict(GERMAN.sentences)}
    said = subprocess.run(
        ["node", "--input-type=module", "-e", program], input=json.dumps([table, sentences]), capture_output=True,
        encoding="utf-8", check=True, timeout=PATIENCE,
    )  # fmt: skip
    assert json.loads(said.stdout) == [GERMAN.said(sentence) for sentence in sentences]


def test_text_without_a_translation_stays_english() -> None:
    assert GERMAN.translated("{} of {} unknown", 1, 2) == "1 of 2 unknown"
