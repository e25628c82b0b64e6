"""Arrays that can be made anew are kept whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.files import keep_arrays, read_kept_arrays

_ARRAYS = {"rows": np.arange(6, dtype=np.float16).reshape(2, 3), "photo ä/1.jpg": np.array(["a", "b"])}


def test_what_was_kept_comes_back(tmp_path: Path) -> None:
    file = tmp_path / "new folder" / "kept.npz"
    keep_arrays(file, "recipe", _ARRAYS)
    back = read_kept_arrays(file, "recipe")
    assert back is not None and back.keys() == _ARRAYS.keys()
    for name, array in _ARRAYS.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == array.dtype


def test_another_recipe_does_not_count(tmp_path: Path) -> None:
    keep_arrays(tmp_path / "kept.npz", "recipe", _ARRAYS)
    assert read_kept_arrays(tmp_path / "kept.npz", "another") is None


@pytest.mark.parametrize("content", [b"", b"PK", b"no archive at all", None])
def test_a_damaged_or_missing_file_does_not_count(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "kept.npz"
    if content is not None:
        file.write_bytes(content)
    assert read_kept_arrays(file, "recipe") is None


@pytest.mark.parametrize("part", [0.2, 0.5, 0.9])
def test_half_a_file_does_not_count(tmp_path: Path, part: float) -> None:
    file = tmp_path / "kept.npz"
    keep_arrays(file, "recipe", _ARRAYS)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(part * len(whole))])
    assert read_kept_arrays(file, "recipe") is None


def test_a_disk_that_refuses_only_costs_time(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    keep_arrays(tmp_path / "file" / "kept.npz", "recipe", _ARRAYS)
    assert read_kept_arrays(tmp_path / "file" / "kept.npz", "recipe") is None
