"""A stored file of another format number is refused with a sentence that says what to do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import FormatError
from engine.core.files import read_versioned


def read(path: Path, data: object) -> dict[str, Any]:
    path.write_text(json.dumps(data), encoding="utf-8")
    return read_versioned(path, {"version": int, "a": int}, version=3, advice="Make it again.")


def test_file_of_the_present_number_is_read(tmp_path: Path) -> None:
    assert read(tmp_path / "a.json", {"version": 3, "a": 1}) == {"version": 3, "a": 1}


@pytest.mark.parametrize("number", [4, 2, 0, -1])
def test_another_number_is_refused_whatever_else_the_file_holds(number: int, tmp_path: Path) -> None:
    with pytest.raises(FormatError) as raised:
        read(tmp_path / "a.json", {"version": number, "b": 1})
    assert str(raised.value) == (
        f"{tmp_path / 'a.json'} has the format number {number}, and this version of Gaussian Heritage reads 3 only: "
        "update Gaussian Heritage if a newer version wrote the file, otherwise make it again."
    )


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"a": 1}, "`version` is missing"),
        ({"version": "3"}, "must be a whole number"),
        ({"version": 3, "b": 1}, "`a` is missing"),
        ([1], "must be an object"),
    ],
)
def test_what_has_no_number_or_another_form_is_said(data: object, said: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=said):
        read(tmp_path / "a.json", data)
