"""Translations of the user interface. Blender looks its texts up in the language of its preferences.

Each JSON file of this folder is a language: the names that Blender's versions have for it, and its texts, labels
and tooltips alike, by the English ones. ``scripts/extract_texts.py`` lists what is missing or not used any more.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.core.files import read_json

LANGUAGES = sorted(Path(__file__).parent.glob("*.json"))
_SCHEMA = {"locales": [str], "texts": {str: str}}
_NAME = __package__ or __name__
_CONTEXTS = ("*", "Operator")
"""Contexts in which Blender looks up labels; those of operators have one of their own."""


def translated(text: str, *values: object) -> str:
    """Return a text in the language of the interface, with `values` in its places ``{}``.

    For texts that Blender does not look up itself: those with values, those that are wrapped, those in headers.
    """
    found: str = bpy.app.translations.pgettext_iface(text)
    return found.format(*values) if values else found


def texts_of(language: Path) -> tuple[list[str], dict[str, str]]:
    """Return Blender's names of a language, and its texts by the English ones, as a file of `LANGUAGES` has them.

    Raises
    ------
    FormatError
        When the file is damaged.
    """
    stored = read_json(language, _SCHEMA, advice="Install the extension again.")
    return stored["locales"], stored["texts"]


def register() -> None:
    """Give Blender the translations."""
    given: dict[str, dict[tuple[str, str], str]] = {}
    for language in LANGUAGES:
        locales, texts = texts_of(language)
        own = {(context, text): one for text, one in texts.items() for context in _CONTEXTS}
        given |= dict.fromkeys(locales, own)
    bpy.app.translations.register(_NAME, given)


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(_NAME)
