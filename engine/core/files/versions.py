"""Format numbers of stored JSON files: a file of another number is refused. Migrations begin with the first release."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..errors import FormatError
from .reading import parse_json, read_text
from .schema import Schema


def read_versioned(path: Path, schema: Schema, *, version: int, advice: str) -> dict[str, Any]:
    """Return the JSON object in a file.

    Parameters
    ----------
    path : Path
        A JSON file with the key ``version``.
    schema : Schema
        Of the whole object.
    version : int
        The format number that is read.
    advice : str
        What the user should do about a damaged file: one sentence.

    Raises
    ------
    FormatError
        When the file cannot be read, or has another format number, as one of a newer release may.
    """
    text = read_text(path, advice=advice)
    found: int = parse_json(text, {"version": int}, source=str(path), advice=advice)["version"]
    if found != version:
        raise FormatError(
            f"{path} has the format number {found}, and this version of Gaussian Heritage reads {version} only: update "
            f"Gaussian Heritage if a newer version wrote the file, otherwise {advice[:1].lower()}{advice[1:]}"
        )
    data: dict[str, Any] = parse_json(text, schema, source=str(path), advice=advice)
    return data
