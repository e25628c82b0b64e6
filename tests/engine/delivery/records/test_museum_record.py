"""The record of an object is read as it was written, and a damaged one is reported in a sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.core.errors import FormatError
from engine.project.objects import MuseumRecord, load_record, save_record


def test_a_record_in_any_writing_system_is_read_as_written(tmp_path: Path) -> None:
    record = MuseumRecord("1906.12", "Vāsē – 花瓶", "CC BY 4.0, Musée", "line one\nline two")
    save_record(tmp_path, "vase", record)
    assert load_record(tmp_path, "vase") == record


def test_object_without_a_record_has_an_empty_one(tmp_path: Path) -> None:
    assert load_record(tmp_path, "vase") == MuseumRecord()
    assert MuseumRecord().as_comments() == []


def test_comments_contain_the_fields_that_are_not_empty() -> None:
    assert MuseumRecord(title="Vase", rights="CC0").as_comments() == ["title Vase", "rights CC0"]


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"version": 99}',
        "{}",
        '{"version": []}',
        '{"version": 1, "title": 7}',
        "[" * 100_000,
        '{"version": 1, "notes": "a\\u0000b"}',
        '{"version": 1, "notes": "\\ud800"}',
        '{"version": 1' + "0" * 5000 + "}",
    ],
)
def test_a_damaged_record_is_reported_in_a_sentence(tmp_path: Path, text: str) -> None:
    file = tmp_path / "objects" / "vase" / "record.json"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    with pytest.raises(FormatError, match=r"record\.json"):
        load_record(tmp_path, "vase")
