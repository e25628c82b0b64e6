"""The real weight files: fetched once into the user's cache, like a user would."""

from __future__ import annotations

from pathlib import Path

from engine.models.catalogue import fetch

__all__ = ["fetched"]


def fetched(*names: str) -> list[Path]:
    """Return the files of the catalogue called `names`, fetching those that are not there."""
    return [fetch(name) for name in names]
