"""Inside the windowed Blender: runs ``commands/*.py``, records gaps of the event loop and slow calls of the add-on.

Started by window.sh with ``blender --python harness.py``. WINDOW_WORK names the folder of commands, answers and logs.
"""

from __future__ import annotations

import contextlib
import glob
import io
import json
import os
import time
import traceback
from typing import Any

import bpy

WORK = os.environ["WINDOW_WORK"]
NAMES: dict[str, Any] = {"bpy": bpy}
TICK = 0.05
GAP = 0.3
"""Seconds without an event from which a gap is recorded."""
_last = time.monotonic()
_blenders_seconds = 0.0


def tick() -> float:
    """Run the commands that have arrived, and record the time since the last call."""
    global _last
    now = time.monotonic()
    if now - _last > GAP:
        record("gaps", {"seconds": round(now - _last, 2)})
    for path in sorted(glob.glob(f"{WORK}/commands/*.py")):
        with open(path) as source:
            code = source.read()
        os.unlink(path)
        said = io.StringIO()
        try:
            with contextlib.redirect_stdout(said):
                exec(compile(code, path, "exec"), NAMES)
        except BaseException:
            said.write(traceback.format_exc())
        with open(path[:-3] + ".tmp", "w") as answer:
            answer.write(said.getvalue())
        os.rename(path[:-3] + ".tmp", path[:-3] + ".out")
    # A command is no gap.
    _last = time.monotonic()
    return TICK


def record(kind: str, entry: dict[str, Any]) -> None:
    """Append an entry to a log of the window."""
    with open(f"{WORK}/{kind}.jsonl", "a") as log:
        log.write(json.dumps({"at": round(time.time(), 2), **entry}) + "\n")


def time_calls(package: str) -> int:
    """Record the duration of each call that Blender makes to the add-on, and return how many functions are timed.

    All of them have a guard, which looks its function up in ``__wrapped__`` at each call. The CPU seconds of the thread
    are recorded apart: the others depend on what else the computer does. So is what Blender's own tools take in them.
    """
    import gc
    import sys

    selecting = sys.modules[f"{package}.operators.select_splats"].HERITAGE_OT_select_splats_within
    if not hasattr(selecting._select_others, "is_timed"):
        selecting._select_others = _of_blender(selecting._select_others)

    count = 0
    for function in [one for one in gc.get_objects() if getattr(one, "__dict__", None) and "is_guard" in vars(one)]:
        inner = vars(function).get("__wrapped__")
        if inner is None or not inner.__module__.startswith(package) or hasattr(inner, "is_timed"):
            continue
        vars(function)["__wrapped__"] = _timed(inner)
        count += 1
    return count


def _timed(inner: Any) -> Any:
    def call(*arguments: Any) -> Any:
        begin, cpu, others = time.perf_counter(), time.thread_time(), _blenders_seconds
        try:
            return inner(*arguments)
        finally:
            seconds, cpu, others = time.perf_counter() - begin, time.thread_time() - cpu, _blenders_seconds - others
            figures = {"seconds": round(seconds, 4), "cpu": round(cpu, 4), "blender": round(others, 4)}
            record("calls", {"name": inner.__qualname__, **figures})

    call.is_timed = True  # type: ignore[attr-defined]
    return call


def _of_blender(inner: Any) -> Any:
    """Return a method that only calls a tool of Blender, and counts its CPU seconds."""

    def call(*arguments: Any) -> Any:
        global _blenders_seconds
        cpu = time.thread_time()
        try:
            return inner(*arguments)
        finally:
            _blenders_seconds += time.thread_time() - cpu

    call.is_timed = True  # type: ignore[attr-defined]
    return call


NAMES["time_calls"] = time_calls
bpy.app.timers.register(tick, first_interval=0.5, persistent=True)
