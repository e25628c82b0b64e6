"""The engine's Python is found where a person would expect it, and starts in clean surroundings."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

import pytest

from .conftest import PACKAGE

process = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.engine_process")
errors = importlib.import_module(f"{PACKAGE}.engine.errors")
EXECUTABLE = "Scripts/python.exe" if os.name == "nt" else "bin/python"


def python_at(folder: Path) -> Path:
    file = folder / EXECUTABLE
    file.parent.mkdir(parents=True)
    file.touch()
    return file


def test_preferences_win_over_the_variable_and_that_over_the_development_environment(tmp_path: Path) -> None:
    chosen, named = python_at(tmp_path / "chosen"), python_at(tmp_path / "named")
    found = python_at(tmp_path / ".venv" / "engine")
    environ = {process.PYTHON_VARIABLE: str(named)}
    inside = tmp_path / "a" / "b"
    assert process.find_python(str(chosen), environ, inside) == chosen
    assert process.find_python("", environ, inside) == named
    assert process.find_python("", {}, inside) == found


def test_without_any_the_person_is_told_where_to_choose(tmp_path: Path) -> None:
    with pytest.raises(errors.EnvironmentProblem, match="Open Preferences > Add-ons > Gaussian Heritage"):
        process.find_python("", {}, tmp_path)


def test_chosen_python_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(errors.EnvironmentProblem, match=r"named in the preferences is not there: .*gone"):
        process.find_python(str(tmp_path / "gone"), {}, tmp_path)


def test_surroundings_are_the_engines_own(tmp_path: Path) -> None:
    environ = {"PYTHONHOME": "blender", "PYTHONPATH": "elsewhere", "PATH": "kept"}
    environment = process.engine_environment(environ, tmp_path / "root", tmp_path / "cache")
    assert "PYTHONHOME" not in environment
    assert (environment["PYTHONPATH"], environment["PATH"]) == (str(tmp_path / "root"), "kept")
    assert environment["NUMBA_CACHE_DIR"] == str(tmp_path / "cache")


def test_command_asks_for_events() -> None:
    assert process.engine_command(Path("p"), "doctor") == ["p", "-m", "engine", "doctor", "--events"]
