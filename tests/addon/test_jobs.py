"""A job is polled without blocking, cancelled and found again, and its errors are always clear."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from .conftest import PACKAGE, ROOT

jobs = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.jobs")
errors = importlib.import_module(f"{PACKAGE}.engine.errors")
Script = Callable[[str], list[str]]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


def start(command: list[str], folder: Path) -> Any:
    return jobs.Job.start(command, folder / "job", kind="test", subject="a vase", environment=ENVIRONMENT)


def poll_until(job: Any, condition: Callable[[Any], bool], seconds: float = 20.0) -> Any:
    """Poll until `condition` is true of the state."""
    end = time.monotonic() + seconds
    while not condition(job.poll()):
        assert time.monotonic() < end, job.poll()
        time.sleep(0.02)
    return job.poll()


def test_state_follows_the_events_and_ends_with_the_outputs(script: Script, tmp_path: Path) -> None:
    job = start(
        script("""
say(StageStarted("training"))
say(Progress("training", 0.25, 12.0, "step 5"))
say(Metric("training", "psnr", 20.0, 46, 0.8))
say(Metric("training", "loss", 0.1, 60))
say(Metric("training", "psnr", 21.5, 67, 1.5))
say(Preview("training", "p.png"))
say(Warned("one photo is blurred"))
print("not an event", flush=True)
say(Finished("done", {"objects": ["vase"]}))
"""),
        tmp_path,
    )
    state = job.wait()
    assert (state.stage, state.fraction, state.seconds_left, state.message) == ("training", 0.25, 12.0, "done")
    assert (state.preview, state.warnings) == ("p.png", ["one photo is blurred"])
    assert (state.metrics, state.curve) == ({"psnr": 21.5, "loss": 0.1}, [(0.8, 20.0), (1.5, 21.5)])
    assert state.finished and not state.error and state.outputs == {"objects": ["vase"]}


def test_poll_does_not_block_and_keeps_an_incomplete_line_for_later(script: Script, tmp_path: Path) -> None:
    job = start(
        script("""
line = to_json_line(Progress("cameras", 0.5))
sys.stdout.write(line[:20]); sys.stdout.flush(); time.sleep(0.5)
print(line[20:], flush=True)
say(Finished())
"""),
        tmp_path,
    )
    before = time.monotonic()
    job.poll()
    assert time.monotonic() - before < 0.3
    state = job.wait()
    assert state.finished and state.fraction == 0.5


def test_error_event_is_the_error_of_the_job(script: Script, tmp_path: Path) -> None:
    state = start(script('say(ErrorEvent("No photo could be read."))\nsys.exit(1)'), tmp_path).wait()
    assert state.error == "No photo could be read." and not state.finished


def test_error_of_a_crash_contains_the_last_line_of_output(script: Script, tmp_path: Path) -> None:
    state = start(script('say(StageStarted("masks"))\nraise MemoryError("no room")'), tmp_path).wait()
    assert "stopped unexpectedly (exit code 1)" in state.error and "MemoryError: no room" in state.error


def test_error_of_a_killed_job_has_the_exit_code(script: Script, tmp_path: Path) -> None:
    state = start(script("import os\nos.kill(os.getpid(), 9)"), tmp_path).wait()
    assert "stopped unexpectedly (exit code -9)" in state.error


WAITS = 'say(Progress("training", 0.1))\nwhile True: time.sleep(0.05)\n'


def test_cancel_interrupts_first(script: Script, tmp_path: Path) -> None:
    handler = """
def stop(*_):
    say(ErrorEvent("Stopped. Run the same command again to continue.", "Cancelled"))
    sys.exit(130)
signal.signal(signal.SIGINT, stop)
"""
    job = start(script(handler + WAITS), tmp_path)
    poll_until(job, lambda state: state.fraction > 0)
    job.cancel()
    assert job.wait().error.startswith("Stopped.")


def test_cancel_kills_a_job_that_ignores_the_interrupt(script: Script, tmp_path: Path) -> None:
    job = start(script("signal.signal(signal.SIGINT, signal.SIG_IGN)\n" + WAITS), tmp_path)
    poll_until(job, lambda state: state.fraction > 0)
    job.cancel(grace_seconds=0.2)
    assert "stopped unexpectedly" in job.wait().error


def test_running_job_is_found_again_and_stopped(script: Script, tmp_path: Path) -> None:
    job = start(script(WAITS), tmp_path)
    poll_until(job, lambda state: state.fraction > 0)
    again = jobs.Job.attach(tmp_path / "job")
    state = again.poll()
    assert (again.kind, again.subject, state.fraction, state.running) == ("test", "a vase", 0.1, True)
    with pytest.raises(errors.ProjectError, match="still working on a vase"):
        start(script(WAITS), tmp_path)
    again.cancel()
    job.wait()  # Reaps the process, as init does after Blender has ended.
    assert "KeyboardInterrupt" in again.wait().error


def test_ended_job_is_found_with_its_outputs(script: Script, tmp_path: Path) -> None:
    start(script('say(Finished("done", {"project": "x"}))'), tmp_path).wait()
    state = jobs.Job.attach(tmp_path / "job").poll()
    assert state.finished and not state.running and state.outputs == {"project": "x"}


def test_another_process_with_the_same_pid_is_not_the_job(script: Script, tmp_path: Path) -> None:
    job = start(script("say(StageStarted('photos'))"), tmp_path)
    job.wait()
    file = tmp_path / "job" / "job.json"
    file.write_text(file.read_text().replace(f'"pid": {job._pid}', f'"pid": {os.getpid()}'))
    assert not jobs.Job.attach(tmp_path / "job").poll().running


def test_folder_without_a_job_gives_none(tmp_path: Path) -> None:
    assert jobs.Job.attach(tmp_path) is None


def test_missing_interpreter_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(errors.DiskError, match="could not be started"):
        start([str(tmp_path / "nowhere")], tmp_path)


def test_new_job_does_not_read_events_of_the_old_one(script: Script, tmp_path: Path) -> None:
    start(script('say(Finished("first"))'), tmp_path).wait()
    assert start(script('say(Finished("second"))'), tmp_path).wait().message == "second"
