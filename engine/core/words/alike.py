"""Words for how much something looks like what a text names, in place of numbers."""

from __future__ import annotations

from typing import Literal

Likeness = Literal["hardly", "a little", "probably", "clearly"]

_LITTLE, _PROBABLE = 0.2, 0.5


def likeness(score: float, sure: float) -> Likeness:
    """Return the word for a confidence, 0 to 1; from `sure` on, something clearly is what the text names."""
    if score >= sure:
        return "clearly"
    if score >= _PROBABLE:
        return "probably"
    return "a little" if score >= _LITTLE else "hardly"
