"""The command line: bad input gets one clear sentence, an exit code that is not 0, and nothing is lost."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from engine.cli.commands import COMMANDS, load_command
from engine.cli.main import build_parser, main
from engine.cli.terminal import EventOutput
from engine.core.errors import Cancelled
from engine.core.events import ErrorEvent, StopCheck
from engine.project.folder import ProjectFolder
from tests.conftest import PATIENCE
from tests.engine.command_line import ROOT, call
from tests.engine.museum import write_photos


def errors_of(capsys: pytest.CaptureFixture[str]) -> list[dict[str, str]]:
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    return [line for line in lines if line["kind"] == "error"]


def photo_folder(folder: Path, count: int) -> Path:
    folder.mkdir()
    for i in range(count):
        Image.effect_noise((320, 240), 60 + i).save(folder / f"{i}.png")
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_every_help_has_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert command == load_command(command).NAME
    with pytest.raises(SystemExit) as stop:
        build_parser().parse_args([command, "--help"])
    assert stop.value.code == 0
    assert "example: python -m engine" in capsys.readouterr().out


def test_missing_photo_folder_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["reconstruct", str(tmp_path / "nowhere"), "--out", str(tmp_path / "p"), "--events"])
    (error,) = errors_of(capsys)
    assert code != 0
    assert error["error"] == "PhotoError"
    assert "nowhere" in error["message"]


def test_folder_without_photos_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "photos").mkdir()
    assert main(["reconstruct", str(tmp_path / "photos"), "--out", str(tmp_path / "p"), "--events"]) != 0
    (error,) = errors_of(capsys)
    assert error["error"] == "PhotoError"


def test_two_photos_are_too_few(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photos = photo_folder(tmp_path / "photos", 2)
    assert main(["reconstruct", str(photos), "--out", str(tmp_path / "p"), "--events"]) != 0
    (error,) = errors_of(capsys)
    assert error["error"] == "CameraError"


def test_output_in_the_photo_folder_itself_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photos = photo_folder(tmp_path / "photos", 3)
    assert main(["reconstruct", str(photos), "--out", str(photos), "--events"]) != 0
    (error,) = errors_of(capsys)
    assert "is the photo folder itself" in error["message"]
    assert len(list(photos.iterdir())) == 3


def test_output_that_cannot_be_written_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photos = photo_folder(tmp_path / "photos", 3)
    (tmp_path / "file").write_text("")
    assert main(["reconstruct", str(photos), "--out", str(tmp_path / "file" / "p"), "--events"]) != 0
    (error,) = errors_of(capsys)
    assert error["error"] == "DiskError"


@pytest.mark.parametrize("command", ["segment", "render", "export", "report"])
def test_project_that_is_none_is_said(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = {
        "segment": ["--prompt", "vase"],
        "render": ["--view", "a.jpg", "--out", str(tmp_path / "a.png")],
        "export": ["--format", "ply", "--out", str(tmp_path / "a.ply")],
        "report": [],
    }[command]
    assert main([command, str(tmp_path), *arguments, "--events"]) != 0
    (error,) = errors_of(capsys)
    assert "is not a Gaussian Heritage project" in error["message"]


def test_export_never_overwrites_without_being_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "scene.ply"
    out.write_text("precious")
    assert main(["export", str(tmp_path), "--format", "ply", "--out", str(out), "--events"]) != 0
    (error,) = errors_of(capsys)
    assert "--overwrite" in error["message"]
    assert out.read_text(encoding="utf-8") == "precious"


def test_prompts_without_objects_contradict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "reconstruct",
        str(tmp_path),
        "--out",
        str(tmp_path / "p"),
        "--no-objects",
        "--prompts",
        "vase",
        "--events",
    ]
    assert main(arguments) == 2
    (error,) = errors_of(capsys)
    assert error["error"] == "SettingsError"


def test_masks_that_are_given_and_made_contradict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    masks = ["--photo-masks", str(tmp_path), "--mask-background"]
    assert main(["reconstruct", str(tmp_path), "--out", str(tmp_path / "p"), *masks, "--events"]) == 2
    (error,) = errors_of(capsys)
    assert error["error"] == "SettingsError" and "only one of them" in error["message"]


def test_unexpected_error_is_a_sentence_and_its_trace_in_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from engine.cli.commands import reconstruct

    def fail(*_: object) -> int:
        raise RuntimeError("database or disk is full")

    ProjectFolder.create(tmp_path / "p")
    monkeypatch.setattr(reconstruct, "run", fail)
    assert main(["reconstruct", str(tmp_path), "--out", str(tmp_path / "p"), "--events"]) == 1
    (error,) = errors_of(capsys)
    assert "database or disk is full" in error["message"]
    assert "Traceback" in (tmp_path / "p" / "log.jsonl").read_text(encoding="utf-8")


def test_error_of_the_system_names_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from engine.cli.commands import reconstruct

    def fail(*_: object) -> int:
        raise PermissionError(13, "Permission denied", "/museum/vase.jpg")

    monkeypatch.setattr(reconstruct, "run", fail)
    answer = call(capsys, "reconstruct", tmp_path, "--out", tmp_path / "p")
    assert answer.error.startswith("/museum/vase.jpg cannot be used: Permission denied.")


def test_python_without_any_package_says_what_to_install() -> None:
    # -S leaves out site-packages, as in a Python in which nothing was installed.
    command = [sys.executable, "-S", "-m", "engine"]
    examined = subprocess.run([*command, "doctor"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert examined.returncode == 1 and "This machine lacks numpy, torch," in examined.stdout and not examined.stderr
    answer = subprocess.run([*command, "segment", "scene"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert answer.returncode == 1
    assert answer.stderr.startswith("Error: This Python (") and "has no package 'numpy'" in answer.stderr
    assert "Traceback" not in answer.stderr


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="a POSIX signal stands in for Windows' Ctrl-Break")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGBREAK", "SIGHUP"])
def test_every_way_to_stop_is_heard(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from engine.cli.commands import reconstruct

    monkeypatch.setattr(signal, "SIGBREAK", signal.SIGUSR1, raising=False)

    def work(_: argparse.Namespace, __: object, should_stop: StopCheck) -> int:
        signal.raise_signal(getattr(signal, name))
        assert should_stop()
        raise Cancelled("Stopped. The next run continues.")

    before = signal.getsignal(getattr(signal, name))
    monkeypatch.setattr(reconstruct, "run", work)
    assert call(capsys, "reconstruct", tmp_path, "--out", tmp_path / "p").code == 130
    assert signal.getsignal(getattr(signal, name)) == before


def test_stopping_when_asked_is_not_called_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    output = EventOutput(json_lines=False, log=None)
    output(ErrorEvent("Stopped.", "Cancelled"))
    output(ErrorEvent("a.jpg is empty.", "PhotoError"))
    output.close()
    assert capsys.readouterr().err == "Stopped.\nError: a.jpg is empty.\n"


SIGNALLED = """
import ctypes, importlib, signal, sys, threading, time
from engine.cli import main as cli
from engine.cli.commands import reconstruct
from engine.core.errors import Cancelled

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
ALL = ["torch", "onnxruntime", "numba", "cv2", "pillow_heif", "av", "engine.cameras.undistortion"]

def in_c(name):
    action = ctypes.create_string_buffer(512)
    ctypes.CDLL(None).sigaction(int(getattr(signal, name)), None, action)
    return ctypes.c_void_p.from_buffer(action).value

def imported(modules):
    for module in modules:
        try:
            importlib.import_module(module)
        except ModuleNotFoundError:
            assert module in ("pillow_heif", "av")  # used where it is installed
    assert "pycolmap" in sys.modules or modules == []

def work(options, emit, should_stop):
    ours = [in_c(name) for name in NAMES]
    MODULES
    assert [in_c(name) for name in NAMES] == ours
    print("ready", flush=True)
    while not (should_stop() and OBEYS):
        time.sleep(0.02)
    raise Cancelled("Stopped. The next run continues.")

reconstruct.run = work
sys.exit(cli.main(["reconstruct", "nowhere", "--out", sys.argv[1]]))
"""
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")


@pytest.fixture(autouse=True)
def signals_as_in_a_terminal() -> Iterator[None]:
    """Undo what nohup or a shell's ``&`` did before pytest began: both let a program ignore signals."""
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name)]
    usual = {number: signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL for number in numbers}
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@contextlib.contextmanager
def started(folder: Path, modules: str, *, obeys: bool = True, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Start a command that waits until it is told to stop, after it called `modules`, an expression."""
    script = SIGNALLED.replace("MODULES", modules).replace("OBEYS", str(obeys))
    command = [sys.executable, "-c", script, str(folder / "p")]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": ROOT}
    with subprocess.Popen(command, **{**pipes, **options}) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


@POSIX
@pytest.mark.parametrize(
    "modules",
    ["imported(ALL)", "t = threading.Thread(target=imported, args=(ALL[-1:],)); t.start(); t.join()"],
    ids=["in the main thread", "in another thread"],
)
def test_no_library_takes_the_signals_that_stop_a_run(tmp_path: Path, modules: str) -> None:
    with started(tmp_path, modules) as process:
        process.send_signal(signal.SIGTERM)
        out, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert errors == "Stopping at the next safe point (once more: at once) ...\nStopped. The next run continues.\n"
    assert out == ""


@POSIX
def test_second_signal_stops_at_once(tmp_path: Path) -> None:
    with started(tmp_path, "imported([])", obeys=False) as process:
        assert process.stderr is not None
        process.send_signal(signal.SIGTERM)
        assert process.stderr.readline().startswith("Stopping at the next safe point")
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=PATIENCE)[1] == "Stopped. Run the same command again to continue.\n"
    assert process.returncode == 130


@POSIX
def test_closed_terminal_stops_the_run_and_nothing_that_is_printed_fails(tmp_path: Path) -> None:
    terminal, side_of_the_run = os.openpty()
    with started(tmp_path, "imported([])", stderr=side_of_the_run) as process:
        os.close(side_of_the_run)
        os.close(terminal)
        process.send_signal(signal.SIGHUP)
        process.communicate(timeout=PATIENCE)
    assert process.returncode == 130


@POSIX
def test_run_under_nohup_goes_on_when_the_terminal_is_closed(tmp_path: Path) -> None:
    ignore = lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)  # noqa: E731
    with started(tmp_path, "imported([])", preexec_fn=ignore) as process:
        process.send_signal(signal.SIGHUP)
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=PATIENCE)[1].endswith("Stopped. The next run continues.\n")


@POSIX
def test_signal_while_pycolmap_is_imported_stops_the_run_like_any_other(tmp_path: Path) -> None:
    write_photos(tmp_path / "photos")
    # At this moment the handlers are those of pycolmap.
    script = """
import builtins, os, signal, sys, time
import_module, sent = builtins.__import__, []

def import_and_signal(name, *rest, **options):
    module = import_module(name, *rest, **options)
    if name == "pycolmap" and not sent:
        sent.append(name)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.1)
    return module

builtins.__import__ = import_and_signal
from engine.__main__ import start
code = start()
assert sent
sys.exit(code)
"""
    command = [sys.executable, "-c", script, "reconstruct", "photos", "--out", "project"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 130, done.stderr
    assert "Stopping at the next safe point" in done.stderr and "Traceback" not in done.stderr
