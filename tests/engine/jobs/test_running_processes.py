"""A process is recognised as a job, or not, with whatever the system has to tell."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from engine.jobs import running_processes as processes

COMMAND = [sys.executable, "-c", "import time; print('ready', flush=True); time.sleep(600)"]

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows lists processes in another way")


@pytest.fixture
def pid(tmp_path: Path) -> Iterator[int]:
    """Run `COMMAND` in `tmp_path`."""
    with subprocess.Popen(COMMAND, cwd=tmp_path, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process.pid
        process.kill()


def test_process_is_recognised_by_its_command_and_folder(pid: int, tmp_path: Path) -> None:
    assert processes.process_runs(pid, COMMAND, tmp_path) is True
    assert processes.process_runs(pid, [*COMMAND[:-1], "pass"], tmp_path) is False
    assert processes.process_runs(os.getpid(), COMMAND, tmp_path) is False
    assert processes.process_runs(1 << 40, COMMAND, tmp_path) is False


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="only Linux tells the folder of a process")
def test_same_command_in_another_folder_is_another_process(pid: int, tmp_path: Path) -> None:
    """A `job.json` of someone else may name any process of ours, with its command."""
    assert processes.process_runs(pid, COMMAND, tmp_path / "elsewhere") is False


def test_without_proc_the_list_of_processes_is_read(pid: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "_PROC", tmp_path / "nowhere")
    listed = processes.process_runs(pid, COMMAND, tmp_path)
    # This machine may have no `ps`.
    assert listed in (True, None)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert processes.process_runs(pid, COMMAND, tmp_path) is None
    assert processes.process_runs(1 << 40, COMMAND, tmp_path) is False
