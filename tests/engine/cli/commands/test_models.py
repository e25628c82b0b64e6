"""`models`: one line per file, and an error for an unknown name."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from engine.cli.main import main
from engine.install.models.cache import CACHE_VARIABLE
from engine.install.models.catalogue import CATALOGUE, ModelFile
from tests.engine.command_line import call

TOKENIZER = b'{"model": {"vocab": {}}}'.ljust(100_000)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A catalogue of two files, both stored."""
    (tmp_path / "models").mkdir()
    models = {}
    for name in ("one", "two"):
        (tmp_path / "models" / name).write_bytes(name.encode())
        digest = hashlib.sha256(name.encode()).hexdigest()
        models[name] = ModelFile(name, "npm:none@1.0.0", name, "MIT", "anyone", name, 3, digest, max_package_size=9)
    for name in list(CATALOGUE):
        monkeypatch.delitem(CATALOGUE, name)
    for name, model in models.items():
        monkeypatch.setitem(CATALOGUE, name, model)
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    return tmp_path / "models"


def test_fetching_prints_one_line_per_file(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "fetch"]) == 0
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == ["one", "two"]


def test_progress_covers_all_files_once(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fractions = [event["fraction"] for event in call(capsys, "models", "fetch").of_kind("progress")]
    assert fractions == [0.5, 1.0]


def test_damaged_file_is_found_by_verify(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "verify"]) == 0
    (cache / "two").write_bytes(b"2")
    capsys.readouterr()
    assert main(["models", "verify"]) == 1
    assert "is damaged" in capsys.readouterr().out


def test_outputs_for_blender_list_the_damaged_files(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (cache / "two").write_bytes(b"2")
    for action, code in (("list", 0), ("verify", 1)):
        answer = call(capsys, "models", action)
        assert (answer.code, answer.of_kind("finished")[0]["outputs"]["problems"]) == (code, ["two"])


def test_unknown_name_lists_the_known_ones(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "Known: one, two." in call(capsys, "models", "fetch", "three").error


@pytest.fixture
def optional(cache: Path, monkeypatch: pytest.MonkeyPatch) -> ModelFile:
    """An optional third file that is missing and whose hash is not known yet."""
    model = ModelFile(
        "three",
        "https://models.invalid/r1/three",
        "three.json",
        "MIT",
        "anyone",
        optional=True,
        approximate_size=len(TOKENIZER),
    )
    monkeypatch.setitem(CATALOGUE, "three", model)
    return model


def test_optional_files_are_listed_with_their_pin_but_neither_fetched_nor_verified(
    cache: Path, optional: ModelFile, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["models", "list"]) == 0
    line = "three: optional, about 0.1 MB, MIT (anyone), https://models.invalid/r1/three, pinned by revision; hash is "
    assert line in capsys.readouterr().out
    assert main(["models", "verify"]) == 0 and main(["models", "fetch"]) == 0
    assert "three" not in capsys.readouterr().out


def test_stored_optional_file_is_verified(cache: Path, optional: ModelFile, capsys: pytest.CaptureFixture[str]) -> None:
    (cache / "three.json").write_bytes(TOKENIZER)
    assert main(["models", "verify"]) == 1
    assert "copied here by hand" in capsys.readouterr().out


def test_offline_folder_delivers_its_files_without_the_network(
    cache: Path, optional: ModelFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    offline = tmp_path / "offline"
    assert "no folder" in call(capsys, "models", "fetch", "--from", offline).error
    offline.mkdir()
    assert "contains no model file" in call(capsys, "models", "fetch", "--from", offline).error
    (offline / "three.json").write_bytes(TOKENIZER)
    assert call(capsys, "models", "fetch", "--from", offline).code == 0
    assert (cache / "three.json").read_bytes() == TOKENIZER
    assert main(["models", "verify"]) == 0
    (cache / "one").unlink()
    assert "contains neither one nor" in call(capsys, "models", "fetch", "one", "--from", offline).error
    assert "can only be used with `models fetch`" in call(capsys, "models", "list", "--from", offline).error
