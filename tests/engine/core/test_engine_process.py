"""A process of the engine runs our code, and its events are read whatever else it writes."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from engine.core.engine_process import EngineProcess, engine_command, engine_environment, events_in
from engine.core.errors import DiskError
from engine.core.events import Progress, to_json_line
from engine.core.system import process_runs
from tests.conftest import wait_until


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


def test_argument_with_a_null_character_is_refused_with_a_sentence(tmp_path: Path) -> None:
    for start in (
        lambda command: EngineProcess.start(command, os.environ, lambda stream: None),
        lambda command: EngineProcess.start_apart(command, os.environ, tmp_path),
    ):
        with pytest.raises(DiskError, match="could not be started"):
            start([sys.executable, "-c", "vase\0"])


def test_closed_process_leaves_nothing_of_what_it_started_and_tells_what_it_said_last() -> None:
    started: list[int] = []
    code = (
        "import subprocess, sys; child = subprocess.Popen([sys.executable, '-c', 'input()'], stdin=-1); "
        "print('no more memory', file=sys.stderr, flush=True); print(child.pid, flush=True); child.wait()"
    )
    command = [sys.executable, "-c", code]
    with EngineProcess.start(command, os.environ, lambda stream: started.append(int(stream.readline()))) as process:
        wait_until(lambda: started)
        assert process.poll() and process.code is None
    assert not process.poll() and process.code and process.last_complaint() == "no more memory"
    wait_until(lambda: not process_runs(started[0], [sys.executable, "-c", "input()"], Path.cwd(), None))
