"""The record of an object survives the disk, and a damaged one is a sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.errors import FormatError
from engine.records import MuseumRecord, load_record, save_record


def test_record_is_read_back_in_every_script(tmp_path: Path) -> None:
    record = MuseumRecord("1906.12", "Vāsē – 花瓶", "CC BY 4.0, Musée", "line one\nline two")
    save_record(tmp_path, "vase", record)
    assert load_record(tmp_path, "vase") == record


def test_object_without_a_record_has_an_empty_one(tmp_path: Path) -> None:
    assert load_record(tmp_path, "vase") == MuseumRecord()
    assert MuseumRecord().as_comments() == []


def test_comments_hold_the_filled_fields() -> None:
    assert MuseumRecord(title="Vase", rights="CC0").as_comments() == ["title Vase", "rights CC0"]


@pytest.mark.parametrize("text", ["{", "[]", '{"version": 99}', "{}"])
def test_damaged_record_is_a_sentence(tmp_path: Path, text: str) -> None:
    file = tmp_path / "objects" / "vase" / "record.json"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    with pytest.raises(FormatError, match=r"record\.json"):
        load_record(tmp_path, "vase")
