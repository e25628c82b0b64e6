"""A process stops when the file that its environment names appears, and its own children are left to it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from engine.core.system import STOP_VARIABLE, StopOnSignal, request_stop, stopping


def test_file_asks_to_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stopping, "_LOOK_SECONDS", 0.0)
    monkeypatch.setenv(STOP_VARIABLE, str(tmp_path / "stop"))
    with StopOnSignal() as should_stop:
        assert not should_stop()
        request_stop(tmp_path / "stop")
        assert should_stop() and should_stop()
        # Its children are stopped by itself.
        assert STOP_VARIABLE not in os.environ


def test_second_request_is_no_error_and_follows_no_link(tmp_path: Path) -> None:
    (tmp_path / "theirs").write_text("kept")
    (tmp_path / "stop").symlink_to(tmp_path / "theirs")
    request_stop(tmp_path / "stop")
    assert (tmp_path / "theirs").read_text(encoding="utf-8") == "kept"
    request_stop(tmp_path / "again")
    request_stop(tmp_path / "again")


def test_without_the_variable_nothing_asks_to_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(STOP_VARIABLE, raising=False)
    with StopOnSignal() as should_stop:
        assert not should_stop()
