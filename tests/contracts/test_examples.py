"""Every prompt that we show as an example is a word that the offline vocabulary knows."""

from __future__ import annotations

import functools
import re

import pytest

from engine.core.words import split_texts, word_list
from engine.objects.spatial import parse_spatial
from tests.conftest import ROOT

FILES = sorted(
    file
    for pattern in (
        "*.md", "Makefile", "compose*.yaml", "docs/*.md", "engine/**/*.py", "engine/serve/page/src/**/*.js",
        "gaussian_heritage_addon/**/*.py", "operators/**/*.py", "scripts/**/*.py", "benchmarks/**/*.py", "demo/**/*.md",
        "engine/core/language/texts/*.json",
    )
    for file in ROOT.glob(pattern)
)  # fmt: skip

_QUOTED = r"""(?P<quote>["'`])(?P<text>[^"'`\n{}$]+)(?P=quote)"""
_FORMS = [
    re.compile(form, re.MULTILINE)
    for form in (
        rf"(?:--prompts?|PROMPTS|\bprompts?|placeholder|DEFAULT_PROMPTS)(?:\s*[:=]\s*|\s+){_QUOTED}",
        r"--prompts?[ =](?P<text>[a-z]+)\b",
        rf"(?:e\.g\.|several:|for example:?|zum Beispiel:?) {_QUOTED}(?=[\"')\s])",
        r"(?:for example:?|zum Beispiel:?) (?P<text>[a-z]+)[.\"']",
        r"(?:commas|Kommas)[^()\"]* \(`?(?P<text>[^()`*]+)`?\)",
        r"classes of an ImageNet classifier \((?P<text>[^()]+), \.\.\.\)",
        r"^- \*(?P<text>[^*\n]+)\*(?=[,:])",
        r"Type what you look for, for example `(?P<text>[^`]+)`",
    )
]
_NO_PROMPTS = re.compile(r"[A-Z_]+|text|prompt|a, b|needs|training")
"""What stands for a prompt in a text, and other words behind such an option or before such a list."""
LEAST_EXAMPLES = 30
"""There are more; fewer mean that the guard does not see them any more."""


@functools.cache
def examples() -> list[tuple[str, str]]:
    """Return the file and the text of each example, as it is shown."""
    found = []
    for file in FILES:
        text = file.read_text(encoding="utf-8")
        for form in _FORMS:
            found += [
                (file.relative_to(ROOT).as_posix(), " ".join(match["text"].split())) for match in form.finditer(text)
            ]
    return [(file, text) for file, text in found if not _NO_PROMPTS.fullmatch(text)]


def unknown(prompt: str) -> list[str]:
    """Return the words of a prompt that the vocabulary does not know."""
    spatial = [parse_spatial(text) for text in split_texts(prompt)]
    nouns = [noun for one in spatial for noun in (one.noun, one.other) if noun]
    return [noun for noun in nouns if not word_list().classes_of(noun)]


def test_every_example_is_a_known_word() -> None:
    shown = examples()
    assert len(shown) >= LEAST_EXAMPLES, shown
    assert {file: text for file, text in shown if unknown(text)} == {}


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("README.md", "vase, teapot"),
        ("engine/cli/main.py", "vase, teapot"),
        ("engine/cli/commands/segment.py", "vase, teapot"),
        ("engine/cli/commands/scene_options.py", "vase, teapot"),
        ("engine/serve/page/src/views/objects.js", "vase, teapot"),
        ("gaussian_heritage_addon/panels/objects_panel.py", "vase, teapot"),
        ("engine/core/language/texts/de.json", "vase, teapot"),
        ("operators/import_photos.py", "vase, teapot"),
        ("operators/isolate.py", "vase"),
        ("docs/curators.md", "vase, teapot"),
        ("docs/text_prompts.md", "bowl on the table"),
        ("README.md", "vase, teapot, shield, mask, obelisk"),
        ("scripts/demo.py", "vase, teapot"),
    ],
)
def test_places_that_show_an_example_are_seen(file: str, text: str) -> None:
    assert (file, text) in examples()


def test_unknown_example_is_reported() -> None:
    assert unknown("vase;bust") == ["bust"] and unknown("left vase; stele") == ["stele"]


def test_german_placeholder_is_the_english_one() -> None:
    """Words are English in every language of the interface."""
    text = (ROOT / "engine" / "core" / "language" / "texts" / "de.json").read_text(encoding="utf-8")
    assert '"vase, teapot": "vase, teapot"' in text
