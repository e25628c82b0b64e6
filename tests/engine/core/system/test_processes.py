"""A process is recognised as a job, or not, with whatever the system has to tell."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from engine.core.system import processes

COMMAND = [sys.executable, "-c", "import time; print('ready', flush=True); time.sleep(600)"]
NOBODY = 1 << 40

on_windows = pytest.mark.skipif(sys.platform != "win32", reason="Windows recognises processes by their start")
not_on_windows = pytest.mark.skipif(sys.platform == "win32", reason="Windows recognises processes by their start")


@pytest.fixture
def pid(tmp_path: Path) -> Iterator[int]:
    """Run `COMMAND` in `tmp_path`."""
    with subprocess.Popen(COMMAND, cwd=tmp_path, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process.pid
        process.kill()


def test_process_is_recognised_and_others_are_not(pid: int, tmp_path: Path) -> None:
    started = processes.start_time(pid)
    assert processes.process_runs(pid, COMMAND, tmp_path, started) is True
    assert processes.process_runs(os.getpid(), COMMAND, tmp_path, started) is False
    assert processes.process_runs(NOBODY, COMMAND, tmp_path, started) is False


@on_windows
def test_another_program_with_the_same_number_is_not_killed(pid: int, tmp_path: Path) -> None:
    """Both are called python.exe; only the time at which they started tells them apart."""
    started = processes.start_time(os.getpid())
    assert processes.process_runs(pid, COMMAND, tmp_path, started) is False
    assert processes.kill_recognised(pid, COMMAND, tmp_path, started) is False
    assert processes.process_runs(pid, COMMAND, tmp_path, processes.start_time(pid)) is True


@on_windows
def test_ended_process_has_no_start(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
        assert processes.start_time(process.pid) is None


@not_on_windows
def test_another_command_is_another_process(pid: int, tmp_path: Path) -> None:
    assert processes.process_runs(pid, [*COMMAND[:-1], "pass"], tmp_path, None) is False


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="only Linux tells the folder of a process")
def test_same_command_in_another_folder_is_another_process(pid: int, tmp_path: Path) -> None:
    """A `job.json` of someone else may name any process of ours, with its command."""
    assert processes.process_runs(pid, COMMAND, tmp_path / "elsewhere", None) is False


@not_on_windows
def test_without_proc_the_list_of_processes_is_read(pid: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "_PROC", tmp_path / "nowhere")
    assert not processes.is_cheap_to_recognise()
    listed = processes.process_runs(pid, COMMAND, tmp_path, None)
    # This machine may have no `ps`.
    assert listed in (True, None)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert processes.process_runs(pid, COMMAND, tmp_path, None) is None
    assert processes.process_runs(NOBODY, COMMAND, tmp_path, None) is False
