"""Names follow the order in which they are given, whatever the clock does, and changes of a file are seen."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from engine.core.system import change_time_ns, name_in_order, times


def test_names_are_in_order_when_the_clock_stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows' clock moves every 16 ms."""
    monkeypatch.setattr(times.time, "time_ns", lambda: 1_000)
    names = [name_in_order(()) for _ in range(5)]
    assert names == sorted(set(names))


def test_name_follows_those_from_before_the_clock_was_set_back(monkeypatch: pytest.MonkeyPatch) -> None:
    stored = f"{4_000_000_000_000_000_000:020d}-77.json"
    assert name_in_order([stored, "notes.json"]) > stored


def test_change_is_seen_when_size_and_time_are_put_back(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"old")
    before = file.stat()
    changed = change_time_ns(file, before)
    while change_time_ns(file, file.stat()) == changed:  # clocks of disks are coarse
        file.write_bytes(b"new")
        os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert file.stat().st_mtime_ns == before.st_mtime_ns
