"""Arrays that can be made anew are kept whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.core.files import ArraySpec, keep_arrays, read_kept_arrays

_ARRAYS = {"rows": np.arange(6, dtype=np.float16).reshape(2, 3), "photo ä/1.jpg": np.array(["a", "b"])}
_SPECS = {"rows": ArraySpec("float16", ("n", 3)), "photo ä/1.jpg": ArraySpec("str", ("n",))}


def test_what_was_kept_comes_back(tmp_path: Path) -> None:
    file = tmp_path / "new folder" / "kept.npz"
    keep_arrays(file, "recipe", _ARRAYS)
    back = read_kept_arrays(file, "recipe", _SPECS)
    assert back is not None and back.keys() == _ARRAYS.keys()
    for name, array in _ARRAYS.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == array.dtype


def test_another_recipe_does_not_count(tmp_path: Path) -> None:
    keep_arrays(tmp_path / "kept.npz", "recipe", _ARRAYS)
    assert read_kept_arrays(tmp_path / "kept.npz", "another", _SPECS) is None


@pytest.mark.parametrize("content", [b"", b"PK", b"no archive at all", None])
def test_a_damaged_or_missing_file_does_not_count(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "kept.npz"
    if content is not None:
        file.write_bytes(content)
    assert read_kept_arrays(file, "recipe", _SPECS) is None


@pytest.mark.parametrize("part", [0.2, 0.5, 0.9])
def test_half_a_file_does_not_count(tmp_path: Path, part: float) -> None:
    file = tmp_path / "kept.npz"
    keep_arrays(file, "recipe", _ARRAYS)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(part * len(whole))])
    assert read_kept_arrays(file, "recipe", _SPECS) is None


def test_a_disk_that_refuses_only_costs_time(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    keep_arrays(tmp_path / "file" / "kept.npz", "recipe", _ARRAYS)
    assert read_kept_arrays(tmp_path / "file" / "kept.npz", "recipe", _SPECS) is None


@pytest.mark.parametrize("header", ["{", "[]", '{"recipe": 1}', "[" * 100_000, '{"recipe": "\\ud800"}'])
def test_a_damaged_header_does_not_count(tmp_path: Path, header: str) -> None:
    np.savez(tmp_path / "kept.npz", header=np.array(header))
    assert read_kept_arrays(tmp_path / "kept.npz", "recipe", _SPECS) is None


def test_a_damaged_array_does_not_count(tmp_path: Path) -> None:
    specs = {"rows": ArraySpec("float64", ("n",))}
    keep_arrays(tmp_path / "kept.npz", "recipe", {"rows": np.arange(100.0)})
    assert read_kept_arrays(tmp_path / "kept.npz", "recipe", specs) is not None
    data = bytearray((tmp_path / "kept.npz").read_bytes())
    data[data.index(np.float64(50.0).tobytes()) + 6] ^= 1
    (tmp_path / "kept.npz").write_bytes(bytes(data))
    assert read_kept_arrays(tmp_path / "kept.npz", "recipe", specs) is None


def test_arrays_of_another_shape_or_without_one_of_them_do_not_count(tmp_path: Path) -> None:
    for arrays in ({"rows": _ARRAYS["rows"]}, {**_ARRAYS, "rows": np.zeros((2, 4), np.float16)}):
        keep_arrays(tmp_path / "kept.npz", "recipe", arrays)
        assert read_kept_arrays(tmp_path / "kept.npz", "recipe", _SPECS) is None
