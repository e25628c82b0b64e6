"""What the scripts of Windows' Python raise."""

from __future__ import annotations


class Problem(Exception):
    """Something that is not as it should be, as a sentence."""
