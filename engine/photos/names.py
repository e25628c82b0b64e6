"""Names of photos that cannot be stored or shown are refused."""

from __future__ import annotations

from pathlib import Path

from ..errors import PhotoError
from ..files import problem_of_inner_name
from ..visible_text import visible

__all__ = ["problem_of_name", "require_utf8_folder"]


def problem_of_name(name: str) -> str | None:
    """Return why a photo cannot be used because of its name, as a sentence; None for a usable name.

    Parameters
    ----------
    name : str
        Relative to the photo folder. It is stored as JSON, written into reports and shown.
    """
    if not _is_utf8(name):
        return "Its name has bytes that are not UTF-8. Rename it."
    if visible(name) != name:
        return "Its name has control characters. Rename it."
    problem = problem_of_inner_name(name)
    return None if problem is None else f"Its name {problem}. Rename it."


def require_utf8_folder(folder: Path) -> None:
    """Raise `PhotoError` when the path of `folder` cannot be stored, because it is not UTF-8."""
    if not _is_utf8(str(folder)) or not _is_utf8(str(folder.resolve())):
        name = visible(str(folder.resolve()))
        raise PhotoError(f"The path of the folder {name} has bytes that are not UTF-8. Rename the folder.")


def _is_utf8(name: str) -> bool:
    # Python represents a byte that is not UTF-8 by a surrogate, which cannot be encoded.
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True
