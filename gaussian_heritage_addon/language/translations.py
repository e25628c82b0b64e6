"""Translations of the user interface. Blender looks its texts up in the language of its preferences."""

from __future__ import annotations

import bpy

from ...engine.core.language import Language, languages

_NAME = __package__ or __name__
_CONTEXTS = ("*", "Operator")
"""Contexts in which Blender looks up labels; those of operators have one of their own."""


def translated(text: str, *values: object) -> str:
    """Return a text in the language of the interface, with `values` in its places ``{}``.

    For texts that Blender does not look up itself: those with values, those that are wrapped, those in headers.
    """
    found: str = bpy.app.translations.pgettext_iface(text)
    return found.format(*values) if values else found


def language() -> Language:
    """Return the language of the interface, or English where there is none for it or the user wants no translations."""
    locale = bpy.app.translations.locale if bpy.context.preferences.view.use_translate_interface else ""
    return next((one for one in languages() if locale in one.locales), languages()[0])


def register() -> None:
    """Give Blender the translations."""
    given = {
        locale: {(context, text): own for text, own in language.texts.items() for context in _CONTEXTS}
        for language in languages()
        for locale in language.locales
    }
    bpy.app.translations.register(_NAME, given)


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(_NAME)
