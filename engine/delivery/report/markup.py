"""HTML in which every value is escaped, unless it was made here itself."""

from __future__ import annotations

import html
import string
from collections.abc import Iterable
from typing import Any

from ...core.visible_text import visible


class Html(str):
    """Text that is HTML already. Only `fill`, `joined` and constants of the page make it."""

    __slots__ = ()


class _Escaping(string.Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        return value if isinstance(value, Html) else html.escape(visible(format(value, format_spec)))

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        # A conversion would make plain text of HTML, or the reverse, unnoticed.
        if conversion is not None:
            raise ValueError(f"conversion {conversion!r} in a template")
        return value


_FORMATTER = _Escaping()


def fill(template: str, /, *values: Any, **named: Any) -> Html:
    """Return the template with its fields replaced as `str.format` does, each value escaped unless it is `Html`.

    Parameters
    ----------
    template : str
        HTML, a constant of the program.
    *values, **named : object
        Values of the fields.
    """
    return Html(_FORMATTER.vformat(template, values, named))


def joined(parts: Iterable[Html | str], separator: str = "") -> Html:
    """Return the parts behind each other, each escaped unless it is `Html`; `separator` is plain text."""
    return Html(html.escape(separator).join(fill("{}", part) for part in parts))
