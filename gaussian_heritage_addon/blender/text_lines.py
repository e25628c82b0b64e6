"""Text broken into lines that fit a width; Blender's labels do not wrap. Does not import bpy."""

from __future__ import annotations

import re
from collections.abc import Callable

_SEPARATORS = re.compile(r"(?<=[/\\_-])")
"""Behind these, a long path or name may be broken."""


def lines_of(text: str, width: float, measure: Callable[[str], float]) -> list[str]:
    """Break `text` into lines.

    Parameters
    ----------
    width : float
        Width of a line, as `measure` returns it.
    measure : callable
        Returns the width of a text.

    Returns
    -------
    list of str
        At least one. Words stay whole; a path that is longer than a line is broken behind a separator, and only a part
        of it that is still too long between any two characters.
    """
    lines, line = [], ""
    for word in text.split():
        if line and measure(f"{line} {word}") <= width:
            line = f"{line} {word}"
            continue
        if line:
            lines.append(line)
        *full, line = _pieces(word, width, measure)
        lines += full
    return [*lines, line] if line or not lines else lines


def _pieces(word: str, width: float, measure: Callable[[str], float]) -> list[str]:
    """Break a word that is wider than a line."""
    if measure(word) <= width:
        return [word]
    pieces = [""]
    for part in filter(None, _SEPARATORS.split(word)):
        if pieces[-1] and measure(pieces[-1] + part) > width:
            pieces.append("")
        for character in part:
            if pieces[-1] and measure(pieces[-1] + character) > width:
                pieces.append("")
            pieces[-1] += character
    return pieces
