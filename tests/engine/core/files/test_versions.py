"""Files of an older release are read in the newest form, those of a newer one are refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import FormatError
from engine.core.files import read_versioned

SCHEMAS = ({"version": int, "a": int}, {"version": int, "b": int}, {"version": int, "c": int})


def b_of_a(data: dict[str, Any]) -> dict[str, Any]:
    return {"b": data["a"] + 1}


def c_of_b(data: dict[str, Any]) -> dict[str, Any]:
    return {"c": data["b"] * 10}


def read(path: Path, data: object) -> dict[str, Any]:
    path.write_text(json.dumps(data))
    return read_versioned(path, SCHEMAS, (b_of_a, c_of_b), advice="Make it again.")


def test_each_version_is_migrated_step_by_step(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    assert read(file, {"version": 1, "a": 1}) == {"version": 3, "c": 20}
    assert read(file, {"version": 2, "b": 1}) == {"version": 3, "c": 10}
    assert read(file, {"version": 3, "c": 1}) == {"version": 3, "c": 1}
    assert json.loads(file.read_text(encoding="utf-8")) == {"version": 3, "c": 1}, "reading changes no file"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"version": 4, "d": 1}, "was written by a newer version of Gaussian Heritage. Update"),
        ({"version": 0}, "no version 0"),
        ({"version": "1"}, "must be a whole number"),
        ({"version": 1, "b": 1}, "`a` is missing"),
        ([1], "must be an object"),
    ],
)
def test_what_cannot_be_migrated_is_said(data: object, said: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=said):
        read(tmp_path / "a.json", data)
