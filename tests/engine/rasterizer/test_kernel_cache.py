"""Compiled kernels are stored where their paths fit, and a folder with too long a path costs only time."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.rasterizer import jit
from engine.training import compile_kernels


def test_no_stored_kernel_has_a_longer_path_than_the_one_that_is_tried() -> None:
    compile_kernels()
    while_written = ".tmp." + "0" * 16
    stored = [path.relative_to(jit.cache_folder()) for path in jit.cache_folder().rglob("*.nb?")]
    assert stored and max(len(f"{path}{while_written}") for path in stored) <= len(str(jit.LONGEST_PATH))


def test_kernels_are_not_stored_where_their_paths_do_not_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(jit, "takes_path", lambda folder, longest: False)
    assert not jit._takes_kernels(tmp_path)
    assert "path is too long" in caplog.text
