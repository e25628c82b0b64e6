from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from engine.grounding.kept_rows import KeptRows

ROWS = np.random.default_rng(0).random((3, 4)).astype(np.float32)


def test_next_process_gets_the_same_rows(tmp_path: Path) -> None:
    KeptRows(tmp_path / "new", width=4, most=2).put("a", ROWS)
    found = KeptRows(tmp_path / "new", width=4, most=2).get("a")
    assert found is not None
    np.testing.assert_array_equal(found, ROWS)
    assert KeptRows(tmp_path / "new", width=4, most=2).get("b") is None


def test_damaged_or_foreign_rows_are_none(tmp_path: Path) -> None:
    kept = KeptRows(tmp_path, width=4, most=2)
    kept.put("a", ROWS)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-5])
    assert kept.get("a") is None
    (tmp_path / "a.npy").write_bytes(b"")
    assert kept.get("a") is None
    assert KeptRows(tmp_path, width=5, most=2).get("a") is None


def test_oldest_rows_go_first(tmp_path: Path) -> None:
    kept = KeptRows(tmp_path, width=4, most=2)
    for age, key in enumerate("abc"):
        kept.put(key, ROWS)
        os.utime(tmp_path / f"{key}.npy", (age, age))
    kept.put("d", ROWS)
    assert sorted(file.stem for file in tmp_path.glob("*.npy")) == ["c", "d"]


def test_disk_that_refuses_costs_only_time(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    KeptRows(tmp_path / "file", width=4, most=2).put("a", ROWS)
