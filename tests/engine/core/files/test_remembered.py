"""What was read of files is kept until they change."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from engine.core.errors import FormatError
from engine.core.files import read_after_change, remembered, stamp_of


def test_folder_is_read_again_only_after_one_of_its_files_changed(tmp_path: Path) -> None:
    read: list[Path] = []

    @read_after_change("a", "sub/b")
    def texts(folder: Path) -> list[str]:
        read.append(folder)
        return [(folder / name).read_text(encoding="utf-8") for name in ("a", "sub/b") if (folder / name).exists()]

    assert [texts(tmp_path), texts(tmp_path)] == [[], []] and len(read) == 1
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/b").write_text("one", encoding="utf-8")
    assert texts(tmp_path) == texts(tmp_path) == ["one"] and len(read) == 2
    before = (tmp_path / "sub/b").stat()
    (tmp_path / "sub/b").write_text("three", encoding="utf-8")
    os.utime(tmp_path / "sub/b", ns=(before.st_atime_ns, before.st_mtime_ns))
    assert texts(tmp_path) == ["three"], "another size at the same time is another file"
    (tmp_path / "sub/b").unlink()
    assert texts(tmp_path) == []


def test_folders_of_a_server_are_kept_beside_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remembered, "_MAX_FOLDERS", 10)
    read: list[Path] = []

    @read_after_change("a")
    def text(folder: Path) -> str:
        read.append(folder)
        return (folder / "a").read_text(encoding="utf-8")

    folders = [tmp_path / str(number) for number in range(10)]
    for folder in folders:
        folder.mkdir()
        (folder / "a").write_text(folder.name, encoding="utf-8")
    for number in range(5):  # one of them changes all the time
        (folders[0] / "a").write_text("x" * number, encoding="utf-8")
        assert [text(folder) for folder in folders] == ["x" * number, *"123456789"]
    assert len(read) == 14
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "a").touch()
    text(tmp_path / "more")
    assert read.clear() is None and text(folders[9]) == "9" and read == []
    assert text(folders[0]) == "xxxx" and read == [folders[0]], "the one that was asked for longest ago is read again"


def test_error_of_ours_is_kept_too_and_an_unexpected_one_is_not(tmp_path: Path) -> None:
    read: list[type[Exception]] = []
    kind: type[Exception] = FormatError

    @read_after_change("a")
    def fail(folder: Path) -> None:
        read.append(kind)
        raise kind("damaged")

    for _ in range(2):
        with pytest.raises(FormatError, match="damaged"):
            fail(tmp_path)
    assert read == [FormatError]
    (tmp_path / "a").write_text("changed", encoding="utf-8")
    kind = OSError
    for _ in range(2):
        with pytest.raises(OSError, match="damaged"):
            fail(tmp_path)
    assert read == [FormatError, OSError, OSError]


def test_path_that_no_file_can_have_has_no_stamp(tmp_path: Path) -> None:
    assert stamp_of(tmp_path / "a\0b") is stamp_of(tmp_path / "missing") is None
