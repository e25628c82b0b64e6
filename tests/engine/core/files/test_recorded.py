"""A file that changed since it was recorded is noticed, also when size and time are those of before."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from engine.core.errors import FormatError
from engine.core.files import is_as_recorded, record_of, recorded

HOUR = 3600


@pytest.fixture
def file(tmp_path: Path) -> Path:
    made = tmp_path / "a.bin"
    made.write_bytes(b"content")
    return made


def test_file_is_as_recorded_until_it_changes(file: Path) -> None:
    record = record_of(file)
    assert record["size"] == 7
    for _ in range(2):
        assert is_as_recorded(file, record)
    for change in (b"contenT", b"conten", b"content.", b""):
        file.write_bytes(change)
        assert not is_as_recorded(file, record)
    file.unlink()
    assert not is_as_recorded(file, record)
    file.mkdir()
    assert not is_as_recorded(file, record)
    file.rmdir()
    with pytest.raises(FormatError, match=r"a\.bin cannot be read"):
        record_of(file)


def test_settled_file_is_hashed_once_and_again_after_it_changed(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hashed = []
    real = recorded.file_sha256
    monkeypatch.setattr(recorded, "file_sha256", lambda path: hashed.append(path) or real(path))
    monkeypatch.setattr("time.time", lambda: file.stat().st_ctime + HOUR)
    record = record_of(file)
    assert is_as_recorded(file, record) and hashed == [file]
    times = file.stat().st_mtime_ns
    file.write_bytes(b"CONTENT")
    os.utime(file, ns=(times, times))
    assert not is_as_recorded(file, record) and hashed == [file, file]
