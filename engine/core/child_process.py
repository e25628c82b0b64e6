"""Work in a child process.

Files from other people are read with bounded time and memory (`run_in_child`): a decoder that loops, crashes or asks
for all memory then fails alone, its file is refused, and the engine goes on. Work of the engine's own may run in
parallel to other work, on cores that are idle (`child_beside`).
"""

from __future__ import annotations

import contextlib
import importlib
import json
import logging
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Literal, Self

from . import errors
from .engine_process import EngineProcess, engine_command, engine_environment
from .errors import Cancelled, HeritageError, is_out_of_memory
from .events import StopCheck, never_stop
from .files import parse_json
from .system import (
    CODE_ROOT,
    end_children_with_this_process,
    end_with_parent,
    exit_cause,
    ignore_signals_of_the_terminal,
    killed_for_memory,
    killed_for_time,
    memory_limited,
    no_core_dumps,
    use_given_cores,
    wall_seconds_limited,
)

_LOG = logging.getLogger(__name__)
_ENGINE = str(__package__).rpartition(".")[0]
# Not `__name__`, which is `__main__` in the child.
_MODULE = f"{__package__}.child_process"
_ROOT = Path(__file__).resolve().parents[_MODULE.count(".")]
_OWN_MODULE = f"{Path(__file__).resolve().parents[1].name}.core.child_process"

_MAX_START_SECONDS = 300.0
"""Imports of a child on a slow disk; they do not count as work."""
_POLL_SECONDS = 0.05
_MAX_ANSWER_BYTES = 16 << 20
_READY = b"\n"


class ChildFailure(HeritageError):
    """A child process broke a bound or died. Callers turn this into an error that names the file and the remedy.

    Attributes
    ----------
    reason : {"memory", "time", "crash"}
        What ended the child; the message says it in a sentence.
    """

    def __init__(self, message: str, reason: Literal["memory", "time", "crash"]) -> None:
        super().__init__(message)
        self.reason = reason


def run_in_child(
    function: str,
    arguments: dict[str, Any],
    *,
    max_memory: int,
    max_seconds: float,
    what: str,
    should_stop: StopCheck = never_stop,
    python: Path | None = None,
) -> Any:
    """Return the result of a function of the engine, called in a child process.

    The child cannot outlive this process, gets no signal of the terminal and leaves no core dump.

    Parameters
    ----------
    function : str
        ``module:name`` below the engine's package, e.g. ``cameras.model_reading:read_model``.
    arguments : dict
        Keyword arguments of the function: JSON values.
    max_memory : int
        Bytes of address space that the function may take after its module was imported; mapped files count. Bounded on
        Linux only: other systems have no such limit, and there only the time is bounded.
    max_seconds : float
        Wall time of the function. Starting Python and importing the module do not count.
    what : str
        Description of the work for messages, e.g. "reading the COLMAP model in /scan/sparse".
    should_stop : callable
        Asked 20 times a second; the child is killed when it returns True.
    python : Path, optional
        Another Python that runs the child, such as that of the engine inside Blender; by default that of this process.

    Returns
    -------
    Any
        The function's result: a JSON value of at most 16 MB of valid text, without NaN and infinity. What is larger
        must be written to a file whose path is among `arguments`.

    Raises
    ------
    HeritageError
        What the function raised, as the same type with the same message.
    ChildFailure
        When the memory or the time was not sufficient, or the child crashed or raised an error that is not ours.
    Cancelled
        When `should_stop` returned True.
    ModuleNotFoundError
        When a package is not installed.
    """
    answer = _Answer()
    with _started(answer, python) as process:
        process.send(_request(function, arguments, max_memory, max_seconds))
        in_time = _wait(process, answer, max_seconds, what, should_stop)
    if should_stop():
        # What asks this process to stop may have ended the child too.
        raise Cancelled(f"Stopped while {what}. The next run continues from here.")
    if not in_time or killed_for_time(_code_of(process)):
        raise ChildFailure(f"{_sentence(what)} took more than {max_seconds:.3g} s.", "time")
    return _outcome(process, answer, max_memory, what)


@contextlib.contextmanager
def child_beside(function: str, arguments: dict[str, Any], *, what: str) -> Iterator[ChildBeside]:
    """Call a function of the engine in a child process while the block runs; at its end the child is dead.

    The function works on the engine's own data: its time and memory are not bounded. Otherwise see `run_in_child`.

    Parameters
    ----------
    function, arguments, what
        See `run_in_child`.
    """
    answer = _Answer()
    with _started(answer) as process:
        process.send(_request(function, arguments, None, None))
        yield ChildBeside(process, answer, what)


class ChildBeside:
    """Work in a child process that runs in parallel to this one, from `child_beside`."""

    def __init__(self, process: EngineProcess, answer: _Answer, what: str) -> None:
        self._process, self._answer, self._what = process, answer, what

    @property
    def finished(self) -> bool:
        """Whether the child has ended."""
        return not self._process.poll()

    def result(self) -> Any:
        """Wait for the child's end and return its function's result.

        Raises
        ------
        HeritageError, ChildFailure, ModuleNotFoundError
            As `run_in_child`.
        """
        self._process.wait()
        return self.end()

    def end(self) -> Any | None:
        """End the child and return its function's result, None when it had not finished.

        From here on `os.times` counts the child's CPU time.

        Raises
        ------
        HeritageError, ChildFailure, ModuleNotFoundError
            As `run_in_child`.
        """
        finished = self.finished
        self._process.close()
        # A process whose other threads are still ending is not reported yet, though its exit code is fixed.
        if self._process.code != 0 and not finished:
            return None
        return _outcome(self._process, self._answer, None, self._what)


class ChildrenBeside:
    """Children of `child_beside`, each from its start until it is ended; a context at whose end they are dead."""

    def __init__(self) -> None:
        self._context = contextlib.ExitStack()
        self._children: list[ChildBeside] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._context.close()

    def begin(self, function: str, arguments: dict[str, Any], *, what: str) -> None:
        """Start a child, see `child_beside`."""
        self._children.append(self._context.enter_context(child_beside(function, arguments, what=what)))

    def take(self) -> list[ChildBeside]:
        """Return the children that were started since the last call, for the caller to end them."""
        children, self._children = self._children, []
        return children


def _request(function: str, arguments: dict[str, Any], max_memory: int | None, max_seconds: float | None) -> bytes:
    request = {"function": function, "arguments": arguments, "max_memory": max_memory, "max_seconds": max_seconds}
    return json.dumps(request).encode("ascii") + b"\n"


class _Answer:
    """The first bytes that a child writes."""

    def __init__(self) -> None:
        self.started = threading.Event()
        self._data = bytearray()

    def read(self, stream: IO[bytes]) -> None:
        """Read a pipe to its end."""
        while chunk := os.read(stream.fileno(), 1 << 16):
            self._data += chunk[: _MAX_ANSWER_BYTES + 1 - len(self._data)]
            self.started.set()

    def text(self) -> str:
        return self._data.decode("utf-8", errors="replace").strip()


def _started(answer: _Answer, python: Path | None = None) -> EngineProcess:
    """Start a child that writes to `answer`. It ends when its standard input does, which stays open."""
    if python is None:
        module, root = _MODULE, _ROOT
    else:
        # There, the engine is a package of its own, whatever it is part of here.
        module, root = _OWN_MODULE, CODE_ROOT
    environment = engine_environment(root=root, other_python=python is not None)
    return EngineProcess.start(engine_command(python=python, module=module), environment, answer.read)


def _wait(process: EngineProcess, answer: _Answer, max_seconds: float, what: str, should_stop: StopCheck) -> bool:
    """Return whether the child ended in time."""
    deadline, working = time.monotonic() + _MAX_START_SECONDS, False
    while not process.wait(_POLL_SECONDS):
        if should_stop():
            raise Cancelled(f"Stopped while {what}. The next run continues from here.")
        if not working and answer.started.is_set():
            deadline, working = time.monotonic() + max_seconds, True
        if time.monotonic() > deadline:
            return False
    return True


def _outcome(process: EngineProcess, answer: _Answer, max_memory: int | None, what: str) -> Any:
    """Return the result in `answer` of a child that has ended, or raise what ended it."""
    code = _code_of(process)
    if code != 0:
        complaints = process.complaints()
        _LOG.error("The child process failed with code %d while %s: %s", code, what, complaints)
        _raise_death(code, complaints, max_memory, what)
    return _result(answer.text(), max_memory, what)


def _code_of(process: EngineProcess) -> int:
    assert process.code is not None
    return process.code


def _raise_death(code: int, text: str, max_memory: int | None, what: str) -> None:
    # Libraries abort when memory is full.
    if killed_for_memory(code) or "bad_alloc" in text or is_out_of_memory(RuntimeError(text)):
        raise _memory_failure(max_memory, what)
    raise ChildFailure(f"{_sentence(what)} crashed ({exit_cause(code)}).", "crash")


def _result(text: str, max_memory: int | None, what: str) -> Any:
    advice = "Report this error."
    answer = parse_json(text, {"outcome": str, "value": object}, source=f"The answer while {what}", advice=advice)
    outcome, value = answer["outcome"], answer["value"]
    if outcome == "result":
        return value
    if outcome == "memory":
        raise _memory_failure(max_memory, what)
    if outcome == "missing":
        raise ModuleNotFoundError(f"No module named {value!r}", name=value)
    if outcome in errors.__all__ and isinstance(error := getattr(errors, outcome), type):
        raise error(value)
    raise ChildFailure(f"{_sentence(what)} failed ({value}).", "crash")


def _memory_failure(max_memory: int | None, what: str) -> ChildFailure:
    need = "more memory than is free" if max_memory is None else f"more than {max_memory / 1e6:.0f} MB of memory"
    return ChildFailure(f"{_sentence(what)} needs {need}.", "memory")


def _sentence(what: str) -> str:
    return what[:1].upper() + what[1:]


def _serve() -> None:
    """Answer one request; the main function of the child."""
    # Libraries print to standard output, and must not write into the answer or read the request.
    requests, answers = os.dup(0), os.dup(1)
    use_given_cores()
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.dup2(2, 1)
    # The parent decides when this process ends, also when a service manager sends SIGTERM to both.
    ignore_signals_of_the_terminal()
    no_core_dumps()
    end_children_with_this_process()
    stream = os.fdopen(requests, "rb")
    line = stream.readline()
    if not line:
        return
    end_with_parent(stream)
    wall_seconds_limited(_MAX_START_SECONDS)
    # Not `parse_json`: file names may have characters that are not valid, which it refuses.
    request = json.loads(line)
    data = json.dumps(_answer(request, answers)).encode("ascii")
    while data:
        data = data[os.write(answers, data) :]
    # Not `sys.exit`: threads of libraries and handlers at exit may hang.
    os._exit(0)


def _answer(request: dict[str, Any], answers: int) -> dict[str, Any]:
    module, _, name = request["function"].partition(":")
    try:
        function = getattr(importlib.import_module(f"{_ENGINE}.{module}"), name)
        os.write(answers, _READY)
        # A little later than the parent, which says it better. Zero: without a bound.
        wall_seconds_limited(0.0 if request["max_seconds"] is None else request["max_seconds"] + 1.0)
        with memory_limited(request["max_memory"]):
            result = function(**request["arguments"])
            json.dumps(result, allow_nan=False)
    except HeritageError as error:
        known = next(one.__name__ for one in type(error).__mro__ if one.__name__ in errors.__all__)
        return {"outcome": known, "value": _valid(str(error))}
    except ModuleNotFoundError as error:
        return {"outcome": "missing", "value": error.name}
    except Exception as error:  # noqa: BLE001 the parent reports it
        if is_out_of_memory(error):
            return {"outcome": "memory", "value": None}
        return {"outcome": "error", "value": _valid(f"{type(error).__name__}: {error}"[:500])}
    return {"outcome": "result", "value": result}


def _valid(text: str) -> str:
    """Return `text` with escapes for characters that are not valid; file names may have some."""
    return text.encode("utf-8", errors="backslashreplace").decode("utf-8")


if __name__ == "__main__":
    _serve()
