"""`make demo` finds the environments in the folder that the user configured."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_environments_are_searched_in_the_folder_of_the_variable(tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "scripts" / "demo.py", "--out", tmp_path / "out"]
    environment = {**os.environ, "GAUSSIAN_HERITAGE_VENVS": str(tmp_path / "elsewhere")}
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert answer.returncode == 1
    assert answer.stderr.startswith(str(tmp_path / "elsewhere" / "engine"))
    assert answer.stderr.endswith("is missing. Run `make setup` first.\n")
    assert not (tmp_path / "out").exists()
