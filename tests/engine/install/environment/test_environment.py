"""The installed engine: where it is, its state, and that nothing else is ever deleted."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from engine.core.errors import ProjectError
from engine.core.files import read_json
from engine.core.system import CODE_ROOT
from engine.install.environment import EngineEnvironment, default_folder
from engine.install.environment import environment as module


@pytest.fixture
def engine(tmp_path: Path) -> EngineEnvironment:
    return EngineEnvironment(tmp_path / "engine")


def _complete(engine: EngineEnvironment) -> None:
    engine.begin()
    engine.python.parent.mkdir(parents=True)
    engine.python.touch()
    engine.finish("3.11", "cpu")


@pytest.mark.parametrize(
    ("platform", "variable", "expected"),
    [
        ("linux", "XDG_DATA_HOME", "data/gaussian-heritage/engine"),
        ("linux", "", "home/.local/share/gaussian-heritage/engine"),
        ("darwin", "", "home/Library/Application Support/gaussian-heritage/engine"),
        ("win32", "LOCALAPPDATA", "data/gheritage"),
        ("win32", "", "home/AppData/Local/gheritage"),
        ("linux", "GAUSSIAN_HERITAGE_ENGINE", "data"),
    ],
)
def test_engine_is_in_the_users_data_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, platform: str, variable: str, expected: str
) -> None:
    for name in ("XDG_DATA_HOME", "LOCALAPPDATA", "GAUSSIAN_HERITAGE_ENGINE"):
        monkeypatch.delenv(name, raising=False)
    if variable:
        monkeypatch.setenv(variable, str(tmp_path / "data"))
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "home")
    monkeypatch.setattr(sys, "platform", platform)
    assert default_folder() == tmp_path / expected


def test_engine_is_ready_only_after_the_last_step(engine: EngineEnvironment) -> None:
    assert engine.state() == "missing"
    engine.begin()
    assert engine.state() == "incomplete"
    _complete(engine)
    assert engine.state() == "ready"


def test_repair_begins_as_incomplete(engine: EngineEnvironment) -> None:
    _complete(engine)
    engine.begin()
    assert engine.state() == "incomplete"


def test_engine_without_its_python_is_incomplete(engine: EngineEnvironment) -> None:
    _complete(engine)
    engine.python.unlink()
    assert engine.state() == "incomplete"


def test_engine_is_incomplete_when_the_python_it_was_made_from_is_gone(engine: EngineEnvironment) -> None:
    """As after an update of Blender: on Windows the environment's own python.exe stays."""
    _complete(engine)
    base = engine.folder.parent / "Blender" / "python" / "bin"
    base.mkdir(parents=True)
    (engine.root / "pyvenv.cfg").write_text(f"home = {base}\nversion = 3.11.9\n", encoding="utf-8")
    assert engine.state() == "ready"
    base.rmdir()
    assert engine.state() == "incomplete"


def test_other_requirements_make_an_engine_outdated(engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch) -> None:
    _complete(engine)
    monkeypatch.setattr(module, "_fingerprint", lambda python, build: "of the next version")
    assert engine.state() == "outdated"


def test_each_change_of_state_is_seen_and_no_file_is_read_again_without_one(
    engine: EngineEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []

    def counted(path: Path, *schema: Any, **options: Any) -> Any:
        read.append(path)
        return read_json(path, *schema, **options)

    monkeypatch.setattr(module, "read_json", counted)
    states = [engine.state()]
    for step in (engine.begin, lambda: _complete(engine), engine.begin):
        step()
        states.append(engine.state())
        n_read = len(read)
        assert engine.state() == states[-1] and len(read) == n_read
    assert states == ["missing", "incomplete", "ready", "incomplete"]


def test_nothing_is_installed_into_a_folder_with_other_files(engine: EngineEnvironment) -> None:
    engine.folder.mkdir()
    (engine.folder / "letter.txt").write_text("dear")
    with pytest.raises(ProjectError, match="is not empty"):
        engine.begin()
    with pytest.raises(ProjectError, match="nothing was deleted"):
        engine.remove()
    assert (engine.folder / "letter.txt").read_text(encoding="utf-8") == "dear"


def test_removed_engine_leaves_nothing_and_follows_no_link(engine: EngineEnvironment, tmp_path: Path) -> None:
    _complete(engine)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "vase.jpg").touch()
    (engine.root / "link").symlink_to(tmp_path / "photos", target_is_directory=True)
    engine.remove()
    assert not engine.folder.exists()
    assert (tmp_path / "photos" / "vase.jpg").exists()


_UNINSTALL = """
import shutil, sys
from engine.install.environment import __main__ as program
tell = program._print_json
def tell_and_uninstall(event):
    tell(event)
    shutil.rmtree(sys.argv[2], ignore_errors=True)
program._print_json = tell_and_uninstall
sys.exit(program.main(["remove", "--folder", sys.argv[1], "--events"]))
"""


def test_removal_ends_by_itself_when_the_add_on_is_uninstalled_meanwhile(
    engine: EngineEnvironment, tmp_path: Path
) -> None:
    _complete(engine)
    # Uninstalling deletes the code of the running program right after its first event.
    code = tmp_path / "extension" / "engine"
    shutil.copytree(CODE_ROOT / "engine", code, ignore=shutil.ignore_patterns("node_modules", "__pycache__"))
    done = subprocess.run(
        [sys.executable, "-c", _UNINSTALL, str(engine.folder), str(code)], check=False, capture_output=True, text=True,
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(code.parent), "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    assert done.returncode == 0 and "was deleted" in done.stdout, done.stderr
    assert not engine.folder.exists() and not code.exists()
