"""Reads the languages: a JSON file each in the folder ``texts``, which has its texts by the English ones.

English stands where it is used and is the key, as with gettext. ``scripts/extract_texts.py`` lists what a language
lacks or does not need any more.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..files import read_json

TEXTS = Path(__file__).resolve().with_name("texts")
"""Folder of the files, one for each language but English, named by its code."""
_SCHEMA = {"name": str, "locales": [str], "texts": {str: str}}

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
    """

    code: str
    name: str
    locales: tuple[str, ...]
    texts: Mapping[str, str]

    def translated(self, text: str, *values: object) -> str:
        """Return an English text in this language, with `values` in its places ``{}``.

        A text that it does not have stays as it is.
        """
        found = self.texts.get(text, text)
        return found.format(*values) if values else found


@functools.cache
def languages() -> tuple[Language, ...]:
    """Return all languages, English first.

    Raises
    ------
    FormatError
        When a file is damaged.
    """
    found = [Language("en", "English", (), {})]
    for file in sorted(TEXTS.glob("*.json")):
        stored = read_json(file, _SCHEMA, advice="Install Gaussian Heritage again.")
        found.append(Language(file.stem, stored["name"], tuple(stored["locales"]), stored["texts"]))
    return tuple(found)
