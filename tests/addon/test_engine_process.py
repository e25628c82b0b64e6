"""The engine's Python is found where a user expects it, and runs in a clean environment."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

import pytest

from .conftest import PACKAGE

process = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.setup.engine_process")
installation = importlib.import_module(f"{PACKAGE}.engine.install.environment")
errors = importlib.import_module(f"{PACKAGE}.engine.core.errors")
EXECUTABLE = "Scripts/python.exe" if os.name == "nt" else "bin/python"


def python_at(folder: Path) -> Path:
    file = folder / EXECUTABLE
    file.parent.mkdir(parents=True)
    file.touch()
    return file


@pytest.fixture
def installed(tmp_path: Path) -> Any:
    """The place of an engine that is not set up yet."""
    return installation.EngineEnvironment(tmp_path / "data" / "engine")


def test_preferences_come_before_the_variable_and_that_before_the_development_environment(
    tmp_path: Path, installed: Any
) -> None:
    preferred, from_variable = python_at(tmp_path / "chosen"), python_at(tmp_path / "named")
    development = python_at(tmp_path / ".venv" / "engine")
    environ = {process.PYTHON_VARIABLE: str(from_variable)}
    assert process.find_python(str(preferred), environ, tmp_path, installed) == preferred
    assert process.find_python("", environ, tmp_path, installed) == from_variable
    assert process.find_python("", {}, tmp_path, installed) == development


def test_engine_that_was_set_up_from_blender_is_used(tmp_path: Path, installed: Any) -> None:
    installed.begin()
    python_at(installed.root)
    with pytest.raises(errors.EnvironmentProblem, match="is not complete. Press Continue Set-Up"):
        process.find_python("", {}, tmp_path / "extension", installed)
    installed.finish("3.11", "cpu")
    assert process.find_python("", {}, tmp_path / "extension", installed) == installed.python


def test_program_above_the_extension_is_not_run(tmp_path: Path, installed: Any) -> None:
    """Others may be able to write to the folders above, such as one that several users share."""
    python_at(tmp_path / ".venv" / "engine")
    python_at(tmp_path / "extensions" / ".venv" / "engine")
    with pytest.raises(errors.EnvironmentProblem, match="The engine is not set up yet"):
        process.find_python("", {}, tmp_path / "extensions" / "gaussian_heritage", installed)


def test_error_without_an_engine_says_what_to_press(tmp_path: Path, installed: Any) -> None:
    with pytest.raises(errors.EnvironmentProblem, match="Press Set Up Engine in the sidebar or in Preferences"):
        process.find_python("", {}, tmp_path, installed)


def test_error_names_a_python_that_does_not_exist(tmp_path: Path, installed: Any) -> None:
    with pytest.raises(errors.EnvironmentProblem, match=r"set in the preferences does not exist: .*gone"):
        process.find_python(str(tmp_path / "gone"), {}, tmp_path, installed)


def test_environment_is_the_engines_own(tmp_path: Path) -> None:
    environ = {"PYTHONHOME": "blender", "PYTHONPATH": "elsewhere", "PATH": "kept"}
    environment = process.engine_environment(environ, tmp_path / "root")
    assert "PYTHONHOME" not in environment
    assert (environment["PYTHONPATH"], environment["PATH"]) == (str(tmp_path / "root"), "kept")
    # Below Blender's folder the paths of compiled kernels would be too long on Windows.
    assert "NUMBA_CACHE_DIR" not in environment and environment["PYTHONUTF8"] == "1"


def test_command_requests_events() -> None:
    assert process.engine_command(Path("p"), "doctor") == ["p", "-m", "engine", "doctor", "--events"]
