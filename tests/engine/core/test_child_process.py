"""Work in a child process: its bounds hold, its errors arrive as ours, and it never outlives the engine."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from engine.core import child_process
from engine.core.child_process import ChildFailure, child_beside, run_in_child
from engine.core.errors import CameraError, Cancelled
from engine.core.system import start_time
from tests.conftest import PATIENCE, wait_until
from tests.engine.command_line import ROOT

WORK = '''
import ctypes, os, sys, time
from engine.core.errors import CameraError

class CutModel(CameraError):
    """A kind of error that only this module knows."""

def echo(**arguments):
    return arguments

def length(text):
    return len(os.fsencode(text))

def fail():
    raise CutModel("The model is cut.")

def bug():
    return {}["key"]

def not_json():
    return float("nan")

def missing():
    import package_that_nobody_has

def fill(megabytes):
    return len(bytearray(megabytes << 20))

def sleep(file=None):
    if file:
        with open(file, "w") as stream:
            stream.write(str(os.getpid()))
    time.sleep(600)

def hold_the_lock(file):
    with open(file, "w") as stream:
        stream.write(str(os.getpid()))
    ctypes.PyDLL(None).sleep(600)

def crash():
    os.abort()

def chatter():
    print("progress", flush=True)
    os.system("echo more")
    sys.stderr.write("x" * 1_000_000)
    return sys.stdin.read()

def grandchild():
    import subprocess
    return subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]).pid

def limits():
    import resource
    return [resource.getrlimit(resource.RLIMIT_CORE)[0], os.getpid() == os.getsid(0)]
'''

POSIX = pytest.mark.skipif(os.name == "nt", reason="signals and groups of processes are POSIX")
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux bounds the memory of a process")


@pytest.fixture(autouse=True)
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The functions above as a module of an engine whose other modules are ours."""
    package = tmp_path / "copy" / "engine"
    package.mkdir(parents=True)
    # Not links, which Windows keeps from most users.
    init = (ROOT / "engine" / "__init__.py").read_text(encoding="utf-8")
    (package / "__init__.py").write_text(f"{init}\n__path__.append({str(ROOT / 'engine')!r})\n", encoding="utf-8")
    (package / "work.py").write_text(WORK)
    monkeypatch.setattr(child_process, "_ROOT", package.parent)
    yield


def call(name: str, *, max_memory: int = 1 << 30, max_seconds: float = PATIENCE, **arguments: Any) -> Any:
    return run_in_child(
        f"work:{name}", arguments, max_memory=max_memory, max_seconds=max_seconds, what="reading the model"
    )


def is_alive(pid: int) -> bool:
    if sys.platform == "win32":
        return start_time(pid) is not None
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    return False


def wait_for_the_end(pid: int) -> None:
    wait_until(lambda: not is_alive(pid))


def content_once_written(file: Path) -> str:
    wait_until(lambda: file.exists() and file.read_text(encoding="utf-8"))
    return file.read_text(encoding="utf-8")


def test_result_comes_back() -> None:
    assert call("echo", a=[1, 2.5, None], b={"text": "彫刻"}) == {"a": [1, 2.5, None], "b": {"text": "彫刻"}}


@POSIX
def test_name_that_is_not_utf8_reaches_the_function() -> None:
    assert call("length", text=os.fsdecode(b"vase\xff.jpg")) == 9


def test_error_of_ours_keeps_its_sentence_and_its_nearest_known_type() -> None:
    with pytest.raises(CameraError) as caught:
        call("fail")
    assert type(caught.value) is CameraError and str(caught.value) == "The model is cut."


@pytest.mark.parametrize(("name", "text"), [("bug", "KeyError: 'key'"), ("not_json", "ValueError: Out of range")])
def test_error_that_is_not_ours_is_a_failure_of_the_child(name: str, text: str) -> None:
    with pytest.raises(ChildFailure, match=text) as caught:
        call(name)
    assert caught.value.reason == "crash"


def test_package_that_is_missing_is_named() -> None:
    with pytest.raises(ModuleNotFoundError) as caught:
        call("missing")
    assert caught.value.name == "package_that_nobody_has"


@LINUX
def test_memory_is_bounded() -> None:
    assert call("fill", megabytes=50, max_memory=100 << 20) == 50 << 20
    with pytest.raises(ChildFailure, match="Reading the model needs more than 105 MB of memory") as caught:
        call("fill", megabytes=150, max_memory=100 << 20)
    assert caught.value.reason == "memory"


def test_time_is_bounded_and_the_process_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, hours = tmp_path / "pid", itertools.count(1)

    def clock() -> float:
        """It stands still until the child works, and runs fast then."""
        return 3600.0 * next(hours) if file.exists() and file.read_text(encoding="utf-8") else 0.0

    monkeypatch.setattr(child_process, "time", SimpleNamespace(monotonic=clock))
    with pytest.raises(ChildFailure, match="Reading the model took more than 600 s") as caught:
        call("sleep", max_seconds=600.0, file=str(file))
    assert caught.value.reason == "time"
    assert not is_alive(int(file.read_text(encoding="utf-8")))


@POSIX
def test_crash_names_its_signal() -> None:
    with pytest.raises(ChildFailure, match=r"Reading the model crashed \(SIGABRT\)") as caught:
        call("crash")
    assert caught.value.reason == "crash"


def test_output_of_libraries_does_not_reach_the_result_or_the_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    assert call("chatter") == ""
    assert capfd.readouterr() == ("", "")


def test_processes_that_the_child_leaves_are_ended() -> None:
    wait_for_the_end(call("grandchild"))


@POSIX
def test_child_dumps_no_core_and_gets_no_signal_of_the_terminal() -> None:
    assert call("limits") == [0, True]


def test_stop_ends_the_child(tmp_path: Path) -> None:
    file = tmp_path / "pid"
    with pytest.raises(Cancelled, match="Stopped while reading the model"):
        run_in_child(
            "work:sleep",
            {"file": str(file)},
            max_memory=1 << 30,
            max_seconds=PATIENCE,
            what="reading the model",
            should_stop=lambda: file.exists() and bool(file.read_text(encoding="utf-8")),
        )
    assert not is_alive(int(file.read_text(encoding="utf-8")))


def test_module_in_the_current_folder_does_not_replace_one_of_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit(7)")
    monkeypatch.chdir(tmp_path)
    assert call("echo", a=1) == {"a": 1}


@pytest.mark.parametrize("name", ["sleep", pytest.param("hold_the_lock", marks=LINUX)])
def test_child_ends_when_the_engine_is_killed(name: str, tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from engine.core import child_process\n"
        "child_process._ROOT = Path(sys.argv[1])\n"
        "child_process.run_in_child(sys.argv[2], {'file': sys.argv[3]}, max_memory=1 << 30, max_seconds=300, what='x')"
    )
    file = tmp_path / "pid"
    command = [sys.executable, "-c", script, str(child_process._ROOT), f"work:{name}", str(file)]
    engine = subprocess.Popen(command, cwd=ROOT)
    child = int(content_once_written(file))
    assert is_alive(child)
    engine.kill()
    engine.wait()
    wait_for_the_end(child)


def test_work_beside_goes_on_until_it_is_ended_and_then_gives_its_result() -> None:
    with child_beside("work:echo", {"a": 1}, what="echoing") as child:
        wait_for_the_end(child._process.pid)
        assert child.end() == {"a": 1}


def test_finished_work_beside_counts_before_its_exit_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    with child_beside("work:echo", {"a": 1}, what="echoing") as child:
        wait_for_the_end(child._process.pid)
        monkeypatch.setattr(child._process, "poll", lambda: True)  # As Linux says while other threads are ending.
        assert child.end() == {"a": 1}


def test_work_beside_that_is_not_finished_is_killed(tmp_path: Path) -> None:
    file = tmp_path / "pid"
    with child_beside("work:sleep", {"file": str(file)}, what="sleeping") as child:
        pid = int(content_once_written(file))
        assert is_alive(pid) and child.end() is None and not is_alive(pid)
    with child_beside("work:sleep", {"file": str(file)}, what="sleeping") as child:
        pass
    assert not is_alive(child._process.pid)


def test_error_of_work_beside_is_raised_at_its_end() -> None:
    with child_beside("work:fail", {}, what="failing") as child:
        wait_for_the_end(child._process.pid)
        with pytest.raises(CameraError, match="The model is cut"):
            child.end()
