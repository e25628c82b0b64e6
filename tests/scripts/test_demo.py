"""`make demo` finds the environments in the folder that the user configured, and says what to open."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

# Not as `demo`, which is a folder of the repository.
demo = SimpleNamespace(**runpy.run_path(str(ROOT / "scripts" / "demo.py")))


def test_environments_are_searched_in_the_folder_of_the_variable(tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "scripts" / "demo.py", "--out", tmp_path / "out"]
    environment = {**os.environ, "GAUSSIAN_HERITAGE_VENVS": str(tmp_path / "elsewhere")}
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert answer.returncode == 1
    assert answer.stderr.startswith(str(tmp_path / "elsewhere" / "engine"))
    assert answer.stderr.endswith("is missing. Run `make setup` first.\n")
    assert not (tmp_path / "out").exists()


def test_demo_ends_by_saying_what_to_open_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(demo.keep.__globals__, "engine_command", lambda engine, words: 0)
    assert demo.keep(tmp_path / "python", tmp_path, "museum_room") == 0
    *_, first, then = capsys.readouterr().out.splitlines()
    assert first.startswith(f"Open first: {tmp_path / 'museum_room.html'}, in a browser.")
    assert str(tmp_path / "scene.blend") in then
