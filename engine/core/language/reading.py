"""Reads the languages: a JSON file each in the folder ``texts``, which has its texts by the English ones.

English stands where it is used and is the key, as with gettext. What the engine says arrives as a finished sentence
with its values; the form that fits it is the key. ``scripts/extract_texts.py`` lists what a language lacks or does not
need any more.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..files import read_json

TEXTS = Path(__file__).resolve().with_name("texts")
"""Folder of the files, one for each language but English, named by its code."""
_SCHEMA = {"name": str, "locales": [str], "texts": {str: str}, "sentences": {str: str}}

Translate = Callable[..., str]
"""`Language.translated` of some language, called ``t`` where it is used."""


@dataclass(frozen=True)
class Language:
    """A language.

    Attributes
    ----------
    code : str
        Of ISO 639-1, as browsers name it.
    name : str
        Its own name for itself.
    locales : tuple of str
        Names that Blender's versions have for it.
    texts : mapping
        Its texts by the English ones.
    sentences : mapping
        What the engine says, by the English forms with ``{}`` in the places of values.
    """

    code: str
    name: str
    locales: tuple[str, ...]
    texts: Mapping[str, str]
    sentences: Mapping[str, str]

    def translated(self, text: str, *values: object) -> str:
        """Return an English text in this language, with `values` in its places ``{}``.

        A text that it does not have stays as it is.
        """
        found = self.texts.get(text, text)
        return found.format(*values) if values else found

    def said(self, sentence: str) -> str:
        """Return a sentence of the engine in this language, or as it is where no form fits it."""
        for form, own in () if sentence in self.texts else self._forms:
            if values := form.fullmatch(sentence):
                return own.format(*values.groups())
        return self.translated(sentence)

    @functools.cached_property
    def _forms(self) -> list[tuple[re.Pattern[str], str]]:
        """The sentences, those with most words first: theirs may fit a shorter form too."""
        return [
            (re.compile("(.+?)".join(map(re.escape, form.split("{}"))), re.DOTALL), own)
            for form, own in sorted(self.sentences.items(), key=lambda one: -len(one[0]))
        ]


@functools.cache
def languages() -> tuple[Language, ...]:
    """Return all languages, English first.

    Raises
    ------
    FormatError
        When a file is damaged.
    """
    found = [Language("en", "English", (), {}, {})]
    for file in sorted(TEXTS.glob("*.json")):
        stored = read_json(file, _SCHEMA, advice="Install Gaussian Heritage again.")
        found.append(
            Language(file.stem, stored["name"], tuple(stored["locales"]), stored["texts"], stored["sentences"])
        )
    return tuple(found)
