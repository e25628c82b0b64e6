"""Translations of the user interface. Blender looks its texts up in the language of its preferences."""

from __future__ import annotations

import bpy

from . import german, german_tooltips

__all__ = ["register", "translated", "unregister"]

_NAME = __package__ or __name__
_LOCALES = ("de", "de_DE")
"""Names of German in different versions of Blender."""
_CONTEXTS = ("*", "Operator")
"""Contexts in which Blender looks up labels; those of operators have one of their own."""


def translated(text: str, *values: object) -> str:
    """Return a text in the language of the interface, with `values` in its places ``{}``.

    For texts that Blender does not look up itself: those with values, those that are wrapped, those in headers.
    """
    found: str = bpy.app.translations.pgettext_iface(text)
    return found.format(*values) if values else found


def register() -> None:
    """Give Blender the translations."""
    every = german.TEXTS | german_tooltips.TEXTS
    texts = {(context, text): own for text, own in every.items() for context in _CONTEXTS}
    bpy.app.translations.register(_NAME, dict.fromkeys(_LOCALES, texts))


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(_NAME)
