from __future__ import annotations

import logging
import os
from pathlib import Path

import numpy as np
import pytest

from engine.objects.grounding.row_cache import RowCache

ROWS = np.random.default_rng(0).random((3, 4)).astype(np.float32)


def test_next_process_gets_the_same_rows(tmp_path: Path) -> None:
    RowCache(tmp_path / "new", width=4, max_files=2).put("a", ROWS)
    found = RowCache(tmp_path / "new", width=4, max_files=2).get("a")
    assert found is not None
    np.testing.assert_array_equal(found, ROWS)
    assert RowCache(tmp_path / "new", width=4, max_files=2).get("b") is None


def test_damaged_or_foreign_rows_are_none(tmp_path: Path) -> None:
    cache = RowCache(tmp_path, width=4, max_files=2)
    cache.put("a", ROWS)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-5])
    assert cache.get("a") is None
    (tmp_path / "a.npy").write_bytes(b"")
    assert cache.get("a") is None
    assert RowCache(tmp_path, width=5, max_files=2).get("a") is None
    for rows in (ROWS * np.float32("nan"), ROWS.astype(np.float64), ROWS[0], np.array([["a"] * 4])):
        np.save(tmp_path / "a.npy", rows)
        assert cache.get("a") is None
    np.savez(tmp_path / "archive.npz", ROWS)
    (tmp_path / "archive.npz").rename(tmp_path / "a.npy")
    assert cache.get("a") is None


def test_oldest_rows_are_deleted_first(tmp_path: Path) -> None:
    cache = RowCache(tmp_path, width=4, max_files=2)
    for age, key in enumerate("abc"):
        cache.put(key, ROWS)
        os.utime(tmp_path / f"{key}.npy", (age, age))
    cache.put("d", ROWS)
    assert sorted(file.stem for file in tmp_path.glob("*.npy")) == ["c", "d"]


def test_disk_that_cannot_be_written_costs_only_time(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("")
    cache = RowCache(tmp_path / "file", width=4, max_files=2)
    with caplog.at_level(logging.INFO):
        cache.put("a", ROWS)
    assert "not stored" in caplog.text
    assert cache.get("a") is None
