"""A process of the engine runs our code, and its events are read whatever else it writes."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

from engine.core.engine_process import engine_command, engine_environment, events_in
from engine.core.events import Progress, to_json_line


def test_module_in_the_current_folder_does_not_pass_for_ours(tmp_path: Path) -> None:
    (tmp_path / "engine").mkdir()
    (tmp_path / "engine" / "__init__.py").write_text("print('not ours')")
    (tmp_path / "engine" / "__main__.py").touch()
    done = subprocess.run(
        engine_command("--help"), cwd=tmp_path, env=engine_environment(), capture_output=True, text=True, check=True
    )
    assert "Photos in, Gaussians and separate objects out." in done.stdout and "not ours" not in done.stdout


def test_modules_that_this_python_finds_are_found_by_its_children_and_by_no_other_python(tmp_path: Path) -> None:
    environ = {"PYTHONPATH": "elsewhere", "PYTHONHOME": "home", "PATH": "kept"}
    own = engine_environment(environ, root=tmp_path)
    assert own["PYTHONPATH"].split(os.pathsep) == [str(tmp_path), "elsewhere"] and own["PYTHONHOME"] == "home"
    other = engine_environment(environ, root=tmp_path, other_python=True)
    assert (other["PYTHONPATH"], other["PATH"], other["PYTHONUTF8"]) == (str(tmp_path), "kept", "1")
    assert "PYTHONHOME" not in other


def test_command_names_the_python_and_the_module() -> None:
    assert engine_command("doctor", "--events") == [sys.executable, "-m", "engine", "doctor", "--events"]
    assert engine_command(Path("a"), python=Path("p"), module="engine.x") == ["p", "-m", "engine.x", "a"]


def test_lines_that_are_no_events_are_passed_over_however_long_they_are() -> None:
    event = Progress("training", 0.5, time=1.0)
    line = to_json_line(event).encode()
    written = b"\n".join([b"a warning of a library", line, b"\xff" * (3 << 20), b'{"v": 1, "kind": "pro', line, b""])
    assert list(events_in(io.BytesIO(written))) == [event, event]
