"""Translations of the user interface. Blender looks its texts up in the language of its preferences."""

from __future__ import annotations

import bpy

from .german import TEXTS

__all__ = ["register", "unregister"]

_NAME = __package__ or __name__
_LOCALES = ("de", "de_DE")
"""Names of German in different versions of Blender."""
_CONTEXTS = ("*", "Operator")
"""Contexts in which Blender looks up labels; those of operators have one of their own."""


def register() -> None:
    """Give Blender the translations."""
    texts = {(context, text): german for text, german in TEXTS.items() for context in _CONTEXTS}
    bpy.app.translations.register(_NAME, dict.fromkeys(_LOCALES, texts))


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(_NAME)
