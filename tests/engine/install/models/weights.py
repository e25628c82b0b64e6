"""The real weight files, fetched once into the user's cache."""

from __future__ import annotations

from pathlib import Path

from engine.install.models.fetching import fetch


def fetched(*names: str) -> list[Path]:
    """Return the files of the catalogue called `names`, fetching the missing ones."""
    return [fetch(name) for name in names]
