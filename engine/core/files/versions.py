"""Versions of stored JSON files: what older releases wrote is migrated step by step when it is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..errors import FormatError
from .reading import parse_json, read_text
from .schema import Schema

__all__ = ["Migration", "read_versioned"]

Migration = Callable[[dict[str, Any]], dict[str, Any]]
"""Returns the data of one version in the form of the next; `read_versioned` changes the number."""


def read_versioned(
    path: Path, schemas: Sequence[Schema], migrations: Sequence[Migration], *, advice: str
) -> dict[str, Any]:
    """Return the JSON object in a file in the form of the newest version. The file itself is not changed.

    Parameters
    ----------
    path : Path
        A JSON file with the key ``version``.
    schemas : sequence of Schema
        Of each version, from 1 to the newest.
    migrations : sequence of Migration
        From version 1 to 2, from 2 to 3, and so on; one fewer than `schemas`.
    advice : str
        What the user should do about a damaged file.

    Raises
    ------
    FormatError
        When the file cannot be read, or a newer release wrote it.
    """
    text = read_text(path, advice=advice)
    version: int = parse_json(text, {"version": int}, source=str(path), advice=advice)["version"]
    if version > len(schemas):
        raise FormatError(
            f"{path} was written by a newer version of Gaussian Heritage. Update Gaussian Heritage, then open it again."
        )
    if version < 1:
        raise FormatError(f"{path} cannot be read: there is no version {version}. {advice}")
    data: dict[str, Any] = parse_json(text, schemas[version - 1], source=str(path), advice=advice)
    for number, migrate in enumerate(migrations[version - 1 :], version + 1):
        data = {**migrate(data), "version": number}
    return data
