"""The task of a worker: one stage of one folder, or one other command, by the engine as a child process.

Answers are plain values, no errors. Whatever goes wrong with the engine is part of the answer; the coordinator decides
whether another worker tries again.
"""

from __future__ import annotations

import contextlib
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from distributed import get_worker

from ... import __version__
from ...core.errors import DiskError, EnvironmentProblem, HeritageError, ProjectInUse
from ...core.events import ErrorEvent, Event, Finished, Metric, Progress, to_json_line
from ...core.files import check, delete_derived, write_problem
from ...pipeline.stages import STAGES
from ...project.folder import ProjectFolder
from ..jobs import EngineRun
from .helped_engine import SCHEDULER_VARIABLE
from .shipping import Bundle, pack, unpack

MODULE = f"{__package__}.helped_engine"
"""What runs the engine."""
_SAY_SECONDS, _RELAY_SECONDS = 5.0, 1.0
"""Seconds between two messages about the progress of a stage, and where somebody watches it."""
_FORECAST = {"stages": [{"stage": str, "memory": int, "memory_high": int, "cpu_seconds": float, "seconds": float}]}
_RUNNING: dict[str, set[EngineRun]] = {}
"""The engines that this worker process runs, by batch."""
_STOPPED: set[str] = set()
_LOCK = threading.Lock()


def topic_of(batch: str) -> str:
    """Return the name under which the workers send the progress of a batch."""
    return f"gaussian-heritage-{batch}"


def run_stage(request: dict[str, Any], bundle: Bundle | None = None) -> dict[str, Any]:
    """Do one stage of one folder, and all stages before it that are not done.

    Parameters
    ----------
    request : dict
        ``version`` of the engine, ``batch``, ``folder`` (its number), ``photos``, ``out``, ``stage``; ``arguments`` of
        ``reconstruct``, or the whole ``command`` instead; ``relay``: whether all events of the engine are sent;
        ``scheduler``: address of the scheduler whose other workers may help, empty for none.
    bundle : dict, optional
        Files of ``photos`` and ``out``, where the worker does not share them; see `shipping`.

    Returns
    -------
    dict
        ``outcome``: ``done``, ``failed``, ``stopped``, ``busy`` (another job works in the folder) or ``killed``;
        ``error`` and ``error_type``; ``computed`` and ``kept`` stages; ``done``: all stages that are done;
        ``forecast`` by stage; ``message`` and ``outputs`` of the end; ``seconds``, ``cpu_seconds``, ``worker``,
        ``host``, ``warnings``; ``project``: its files, where they were sent.
    """
    worker = get_worker()
    answer: dict[str, Any] = {
        "outcome": "failed", "error": "", "error_type": "", "computed": [], "kept": [], "done": [], "forecast": {},
        "message": "", "outputs": {}, "seconds": 0.0, "cpu_seconds": None, "worker": worker.address,
        "host": socket.gethostname(), "warnings": [], "project": None,
    }  # fmt: skip
    begin = time.monotonic()
    scratch: Path | None = None
    said = {"folder": request["folder"], "stage": request["stage"], "worker": worker.address}

    def say(kind: str, **values: Any) -> None:
        worker.log_event(topic_of(request["batch"]), {"kind": kind, **said, **values})

    try:
        if request["version"] != __version__:
            raise EnvironmentProblem(
                f"The worker {worker.address} has version {__version__} of the engine, and this computer "
                f"{request['version']}. Install the same version on both."
            )
        photos, out = Path(request["photos"]), Path(request["out"])
        say("started")
        if bundle is not None:
            try:
                scratch = Path(tempfile.mkdtemp(prefix="batch-", dir=worker.local_directory))
            except OSError as error:
                raise write_problem(Path(worker.local_directory), error) from error
            photos, out = scratch / "photos", scratch / "project"
            unpack(bundle["photos"], photos)
            unpack(bundle["project"], out)
        _run_engine(request, photos, out, answer, say)
        if bundle is not None:
            answer["project"] = pack(out, None)
    except HeritageError as error:
        answer.update(outcome="failed", error=str(error), error_type=type(error).__name__)
    finally:
        if scratch is not None:
            with contextlib.suppress(DiskError):
                delete_derived(scratch.parent, scratch.name)
    answer["seconds"] = time.monotonic() - begin
    return answer


def _run_engine(
    request: dict[str, Any], photos: Path, out: Path, answer: dict[str, Any], say: Callable[..., None]
) -> None:
    last = [0.0]

    def on_event(event: Event) -> None:
        # How it ends is part of the answer.
        if isinstance(event, ErrorEvent | Finished) or (isinstance(event, Metric) and event.stage == "batch"):
            return
        if isinstance(event, Progress):
            if time.monotonic() - last[0] < (_RELAY_SECONDS if request["relay"] else _SAY_SECONDS):
                return
            last[0] = time.monotonic()
            say("progress", now=event.stage, fraction=event.fraction)
        if request["relay"]:
            say("event", line=to_json_line(event))

    batch, stage = request["batch"], request["stage"]
    command = request["command"] or ["reconstruct", str(photos), f"--out={out}", *request["arguments"]]
    if command[0] == "reconstruct":
        command = [*command, f"--until={stage}"]
    with _LOCK:
        if batch in _STOPPED:
            answer["outcome"] = "stopped"
            return
        variables = {SCHEDULER_VARIABLE: request["scheduler"]}
        engine = EngineRun(command, on_event, module=MODULE, variables=variables)
        _RUNNING.setdefault(batch, set()).add(engine)
    try:
        code = engine.wait()
    finally:
        with _LOCK:
            _RUNNING[batch].discard(engine)
    state = engine.state
    answer.update(
        error=state.error, error_type=state.error_type, computed=engine.computed, kept=engine.kept,
        cpu_seconds=engine.cpu_seconds, warnings=state.warnings[-20:], message=state.message, outputs=state.outputs,
    )  # fmt: skip
    if code == 0 and state.finished:
        answer["outcome"] = "done"
    elif engine.stopped or state.error_type == "Cancelled":
        answer["outcome"] = "stopped"
    elif state.error_type == ProjectInUse.__name__:
        answer["outcome"] = "busy"
    elif code < 0 and not state.error:
        answer.update(outcome="killed", error=f"The engine was killed by signal {-code}, often for lack of memory.")
    elif not state.error:
        answer["error"] = f"The engine ended with code {code}: {engine.process.last_complaint()}"
    _add_state(out, answer)


def _add_state(out: Path, answer: dict[str, Any]) -> None:
    """Add the stages that are done, and the forecast."""
    try:
        project = ProjectFolder.open_existing(out)
    except HeritageError:
        return
    answer["done"] = [stage for stage in STAGES if project.stage_record(stage) is not None]
    answer["forecast"] = stored_forecast(project)


def stored_forecast(project: ProjectFolder) -> dict[str, dict[str, Any]]:
    """Return the expected memory and seconds by stage; empty where a project has no forecast yet."""
    stored = project.get("forecast")
    if check(stored, _FORECAST) is not None:
        return {}
    return {one["stage"]: {name: one[name] for name in _FORECAST["stages"][0]} for one in stored["stages"]}


def stop_stages(batch: str) -> int:
    """Ask the engines of a batch in this worker process to stop, and return how many run; later ones do not start."""
    with _LOCK:
        _STOPPED.add(batch)
        running = list(_RUNNING.get(batch, ()))
        for engine in running:
            engine.stop()
    return len(running)
