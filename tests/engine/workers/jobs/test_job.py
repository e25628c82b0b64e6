"""A job is polled without blocking, cancelled and found again, and its errors are always clear."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from engine.core import engine_process, errors
from engine.core.events import Progress, StageStarted
from engine.core.system import start_time
from engine.workers.jobs import job as jobs
from tests.conftest import ROOT, wait_until

Script = Callable[[str], list[str]]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


def start(command: list[str], folder: Path) -> Any:
    return jobs.Job.start(command, folder / "job", kind="test", subject="a vase", environment=ENVIRONMENT)


def poll_until(job: Any, condition: Callable[[Any], bool]) -> Any:
    """Poll until `condition` is true of the state."""
    wait_until(lambda: condition(job.poll()))
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
    half, rest = tmp_path / "half", tmp_path / "rest"
    job = start(
        script(f"""
from pathlib import Path
line = to_json_line(Progress("cameras", 0.5))
sys.stdout.write(line[:20]); sys.stdout.flush(); Path({str(half)!r}).touch()
while not Path({str(rest)!r}).exists(): time.sleep(0.02)
print(line[20:], flush=True)
say(Finished())
"""),
        tmp_path,
    )
    wait_until(half.exists)
    # The rest of the line comes only after this returns.
    assert job.poll().fraction == 0.0
    rest.touch()
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
    assert re.search(r"stopped unexpectedly \(exit code -?9\)", state.error)


WAITS = 'say(Progress("training", 0.1))\nwhile True: time.sleep(0.05)\n'


STOPS = """
from engine.core.system import StopOnSignal
with StopOnSignal() as should_stop:
    say(Progress("training", 0.1))
    while not should_stop(): time.sleep(0.02)
say(ErrorEvent("Stopped. Run the same command again to continue.", "Cancelled"))
sys.exit(130)
"""


def test_cancel_lets_the_job_save_its_work_first(script: Script, tmp_path: Path) -> None:
    job = start(script(STOPS), tmp_path)
    poll_until(job, lambda state: state.fraction > 0)
    job.cancel()
    state = job.wait()
    assert state.error.startswith("Stopped.") and state.error_type == "Cancelled"


def test_cancelled_job_does_not_stop_the_next_one_in_its_folder(script: Script, tmp_path: Path) -> None:
    test_cancel_lets_the_job_save_its_work_first(script, tmp_path)
    once = "from engine.core.system import StopOnSignal\nwith StopOnSignal() as stop: say(Finished(str(stop())))"
    assert start(script(once), tmp_path).wait().message == "False"


def test_cancel_kills_a_job_that_does_not_stop(script: Script, tmp_path: Path) -> None:
    job = start(script(WAITS), tmp_path)
    poll_until(job, lambda state: state.fraction > 0)
    job.cancel(grace_seconds=0.2)
    assert "stopped unexpectedly" in job.wait().error


def test_killed_job_takes_the_programs_that_it_started_with_it(script: Script, tmp_path: Path) -> None:
    mark = tmp_path / "child"
    child = f"import os, time; open({str(mark)!r}, 'w').write(str(os.getpid())); time.sleep(600)"
    job = start(
        script(f"""
import os, subprocess
from engine.core.system import end_children_with_this_process
end_children_with_this_process()
subprocess.Popen([sys.executable, "-c", {child!r}])
while not os.path.exists({str(mark)!r}) or not open({str(mark)!r}).read(): time.sleep(0.02)
say(Progress("training", 0.1))
time.sleep(600)
"""),
        tmp_path,
    )
    poll_until(job, lambda state: state.fraction > 0)
    job.cancel(grace_seconds=0.0)
    job.wait()
    pid = int(mark.read_text(encoding="utf-8"))
    wait_until(lambda: has_ended(pid))


def has_ended(pid: int) -> bool:
    """Return whether there is no such process, or only its remains that nobody has collected."""
    if not Path("/proc").is_dir():
        return start_time(pid) is None
    state = Path(f"/proc/{pid}/stat")
    return not state.exists() or state.read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "Z"


def test_running_job_is_found_again_and_stopped(script: Script, tmp_path: Path) -> None:
    job = start(script(WAITS), tmp_path)
    poll_until(job, lambda state: state.fraction > 0)
    again = jobs.Job.attach(tmp_path / "job")
    state = again.poll()
    assert (again.kind, again.subject, state.fraction, state.running) == ("test", "a vase", 0.1, True)
    with pytest.raises(errors.ProjectError, match="still working on a vase"):
        start(script(WAITS), tmp_path)
    again.cancel(grace_seconds=0.0)
    again.poll()
    job.wait()  # Reaps the process, as init does after Blender has ended.
    assert "stopped unexpectedly" in again.wait().error and not again.poll().running


def test_ended_job_is_found_with_its_outputs(script: Script, tmp_path: Path) -> None:
    start(script('say(Finished("done", {"project": "x"}))'), tmp_path).wait()
    state = jobs.Job.attach(tmp_path / "job").poll()
    assert state.finished and not state.running and state.outputs == {"project": "x"}


def test_another_process_with_the_same_pid_is_not_the_job(script: Script, tmp_path: Path) -> None:
    job = start(script("say(StageStarted('photos'))"), tmp_path)
    job.wait()
    file = tmp_path / "job" / "job.json"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(f'"pid": {job._process.pid}', f'"pid": {os.getpid()}'), encoding="utf-8")
    assert not jobs.Job.attach(tmp_path / "job").poll().running


def test_folder_without_a_job_gives_none(tmp_path: Path) -> None:
    assert jobs.Job.attach(tmp_path) is None


def test_missing_interpreter_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(errors.DiskError, match="could not be started"):
        start([str(tmp_path / "nowhere")], tmp_path)


def test_new_job_does_not_read_events_of_the_old_one(script: Script, tmp_path: Path) -> None:
    start(script('say(Finished("first"))'), tmp_path).wait()
    assert start(script('say(Finished("second"))'), tmp_path).wait().message == "second"


# ---- files of jobs that are damaged, huge or someone else's


@pytest.mark.parametrize(
    "record",
    [
        "", "[]", "{", "null", '{"kind": 1}', "\xff", "[" * 100_000,
        '{"kind": "a", "subject": "b", "command": "c", "pid": 5}',
        '{"kind": "a", "subject": "b", "command": [], "pid": 5}',
        '{"kind": "a", "subject": "b", "command": ["c"], "pid": 0}',
        '{"kind": "a", "subject": "b", "command": ["c"], "pid": -1}',
        '{"kind": "a", "subject": "b", "command": ["c"], "pid": 99999999999999}',
    ],
)  # fmt: skip
def test_damaged_record_is_no_job(record: str, tmp_path: Path) -> None:
    folder = tmp_path / "job"
    folder.mkdir()
    (folder / "job.json").write_text(record, encoding="latin-1")
    assert jobs.Job.attach(folder) is None


def test_folder_that_is_a_link_is_no_job(script: Script, tmp_path: Path) -> None:
    start(script("say(Finished())"), tmp_path / "theirs").wait()
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours" / "job").symlink_to(tmp_path / "theirs" / "job")
    assert jobs.Job.attach(tmp_path / "theirs" / "job") is not None
    assert jobs.Job.attach(tmp_path / "ours" / "job") is None


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="only Linux tells the folder of a process")
def test_cancel_does_not_end_a_process_that_a_record_from_elsewhere_names(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "import time; print('ready', flush=True); time.sleep(600)"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as other:
        assert other.stdout is not None
        other.stdout.readline()
        (tmp_path / "job").mkdir()
        record = {"kind": "segment", "subject": "x", "pid": other.pid, "command": command}
        (tmp_path / "job" / "job.json").write_text(json.dumps(record))
        job = jobs.Job.attach(tmp_path / "job")
        job.cancel(grace_seconds=0.0)
        job._process.kill()
        assert not job.poll().running and other.poll() is None
        other.kill()


def test_unknown_process_is_not_ended(script: Script, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = start(script(WAITS), tmp_path)
    monkeypatch.setattr(engine_process, "process_runs", lambda *_: None)
    again = jobs.Job.attach(tmp_path / "job")
    assert again.poll().running
    with pytest.raises(errors.EnvironmentProblem, match="does not report whether process"):
        again.cancel(grace_seconds=0.0)
    assert again.poll().running and job.poll().running
    job.cancel(grace_seconds=0.0)
    job.wait()


def job_with_events(events: bytes, folder: Path) -> Any:
    """Return a job that has ended, with these events."""
    job = start([sys.executable, "-c", ""], folder)
    job._process.wait()
    (folder / "job" / "events.jsonl").write_bytes(events)
    return job


FINISHED = b'{"v": 1, "kind": "finished", "message": "done", "time": 0.0, "outputs": {}}\n'


@pytest.mark.parametrize(
    "line",
    [
        b'{"v":1,"kind":[]}', b'{"v":[],"kind":"progress"}', b"[]", b"\xff\xfe", b"[" * 50_000, b"1e999", b"NaN",
        b'{"v":1,"kind":"progress","stage":5,"fraction":"x"}', b'{"v":1,"kind":"finished","outputs":[]}',
        b'{"v":1,"kind":"progress","stage":"a","fraction":1e999}', b'{"v":1,"kind":"metric","stage":"a","name":{}}',
        b'{"v":1,"kind":"warning","message":null}', b'{"v":1,"kind":"warning","message":"\\ud800"}',
        b'{"v":1,"kind":"preview","stage":"a","path":["/"]}', b"x" * 3_000_000,
    ],
)  # fmt: skip
def test_damaged_events_are_skipped(line: bytes, tmp_path: Path) -> None:
    state = job_with_events(line + b"\n" + FINISHED, tmp_path).wait(interval=0.0)
    assert state.finished and state.message == "done" and state.error == ""
    assert state.progress_line() and state.warnings == [] and state.preview == ""


def test_line_of_progress_says_what_the_engine_does() -> None:
    state = jobs.JobState()
    state.update(Progress("planning", 0.0, 10.0, "measuring this machine's speed, once"))
    assert state.progress_line() == "planning 0%, 10 s left: measuring this machine's speed, once"
    state.update(StageStarted("cameras"))
    assert state.progress_line() == "cameras 0%"


def test_poll_reads_a_bounded_part_of_the_events(tmp_path: Path) -> None:
    line = b'{"v": 1, "kind": "warning", "message": "%s", "time": 0.0}\n' % (b"x" * 1000)
    job = job_with_events(line * 5000 + FINISHED, tmp_path)
    polls, offset = 1, 0
    while job.poll().running:
        assert job._offset - offset <= jobs._MAX_READ
        polls, offset = polls + 1, job._offset
    assert polls >= 5 and job.poll().finished and len(job.poll().warnings) <= jobs._MAX_KEPT


def test_state_of_a_chatty_job_stays_small(tmp_path: Path) -> None:
    metric = '{"v": 1, "kind": "metric", "stage": "a", "name": "%s", "value": 1, "seconds": %d, "time": 0.0}\n'
    lines = "".join(metric % (name, n) for n in range(9000) for name in ("psnr", f"m{n}"))
    state = job_with_events(lines.encode() + FINISHED, tmp_path).wait(interval=0.0)
    assert state.finished and len(state.metrics) <= jobs._MAX_KEPT and len(state.curve) <= jobs._MAX_KEPT
    assert state.curve[-1] == (8999.0, 1.0)


def test_long_errors_are_shown_by_the_end_of_their_last_line(tmp_path: Path) -> None:
    job = job_with_events(b"", tmp_path)
    (tmp_path / "job" / "errors.txt").write_bytes(b"x" * 5_000_000 + b"\nthe reason" + b"\xff")
    assert "Its last line was: the reason" in job.poll().error
