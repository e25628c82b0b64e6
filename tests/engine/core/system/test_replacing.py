"""A file that another program reads is replaced when it lets go; otherwise the message says what holds it."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import DiskError
from engine.core.files import atomic_write, delete_derived
from engine.core.system import advice_for, replacing


class Held(PermissionError):
    """Windows' answer about a file that another program has open."""

    winerror = 32


def held_for(n_trials: int, real: Any) -> Any:
    """Return `real` as it behaves while another program has the file open for the first `n_trials` trials."""
    left = iter(range(n_trials))

    def act(*arguments: Any, **named: Any) -> Any:
        if next(left, None) is not None:
            raise Held(errno.EACCES, "The process cannot access the file")
        return real(*arguments, **named)

    return act


@pytest.fixture(autouse=True)
def no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replacing.time, "sleep", lambda seconds: None)


def test_file_that_is_read_for_a_moment_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "preview.png"
    file.write_bytes(b"old")
    monkeypatch.setattr(replacing.os, "replace", held_for(4, os.replace))
    with atomic_write(file) as stream:
        stream.write(b"new")
    assert file.read_bytes() == b"new" and list(tmp_path.iterdir()) == [file]


def test_file_that_is_read_for_a_moment_is_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "file").touch()
    monkeypatch.setattr(replacing.shutil, "rmtree", held_for(4, replacing.shutil.rmtree))
    delete_derived(tmp_path, "folder")
    assert list(tmp_path.iterdir()) == []


def test_file_that_stays_open_elsewhere_is_named_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "scene.ply"
    file.write_bytes(b"old")
    monkeypatch.setattr(replacing.os, "replace", held_for(1000, os.replace))
    named = r"scene\.ply: .*Another program has it open: close it"
    with pytest.raises(DiskError, match=named) as caught, atomic_write(file) as stream:
        stream.write(b"new")
    assert "Free some space" not in str(caught.value)
    assert file.read_bytes() == b"old" and list(tmp_path.iterdir()) == [file]


@pytest.mark.skipif(sys.platform != "win32", reason="elsewhere an open file can be replaced")
def test_windows_names_an_open_file(tmp_path: Path) -> None:
    file = tmp_path / "scene.ply"
    file.write_bytes(b"old")
    with file.open("rb"), pytest.raises(DiskError, match="have it open|has it open"), atomic_write(file) as stream:
        stream.write(b"new")
    assert file.read_bytes() == b"old"


@pytest.mark.parametrize(
    ("number", "advice"),
    [(errno.ENOSPC, "Free some space"), (errno.EROFS, "read-only|write to"), (errno.EACCES, "may not write|write to")],
)
def test_advice_fits_the_reason(number: int, advice: str) -> None:
    import re

    assert re.search(advice, advice_for(OSError(number, os.strerror(number)), Path("scene.ply")))


def test_too_long_path_is_named_with_its_length(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replacing, "_limits_paths", lambda: True)
    path = Path("C:/" + "x" * 300)
    assert "303 characters" in advice_for(FileNotFoundError(errno.ENOENT, "No such file"), path)
