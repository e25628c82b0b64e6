"""`models`: one line a file, and a name that is none is said."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from engine.cli import main
from engine.models.catalogue import CACHE_VARIABLE, CATALOGUE, ModelFile
from tests.engine.command_line import call


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A catalogue of two files, both there."""
    (tmp_path / "models").mkdir()
    models = {}
    for name in ("one", "two"):
        (tmp_path / "models" / name).write_bytes(name.encode())
        digest = hashlib.sha256(name.encode()).hexdigest()
        models[name] = ModelFile(name, "npm:none@1.0.0", name, name, 3, digest, "MIT", "anyone")
    for name in list(CATALOGUE):
        monkeypatch.delitem(CATALOGUE, name)
    for name, model in models.items():
        monkeypatch.setitem(CATALOGUE, name, model)
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    return tmp_path / "models"


def test_fetching_prints_one_line_a_file(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "fetch"]) == 0
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == ["one", "two"]


def test_bar_runs_once_through_all_files(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fractions = [event["fraction"] for event in call(capsys, "models", "fetch").of_kind("progress")]
    assert fractions == [0.5, 1.0]


def test_damaged_file_is_found_by_verify(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "verify"]) == 0
    (cache / "two").write_bytes(b"2")
    capsys.readouterr()
    assert main(["models", "verify"]) == 1
    assert "is damaged" in capsys.readouterr().out


def test_unknown_name_lists_the_known_ones(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "Known: one, two." in call(capsys, "models", "fetch", "three").error
