"""A process of the engine, whoever starts it: command line, environment variables, events, and its end."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from .errors import DiskError, FormatError, StartError
from .events import Event, from_json_line
from .files import opened
from .system import (
    CODE_ROOT,
    STOP_VARIABLE,
    is_cheap_to_recognise,
    kill_group,
    kill_recognised,
    own_group,
    process_runs,
    request_stop,
    start_time,
    with_utf8,
)

EVENTS_FILE, ERRORS_FILE, STOP_FILE = "events.jsonl", "errors.txt", "stop"
"""Files in the folder of a process: what it writes, to standard output and standard error, and what asks it to stop."""

_MAX_LINE = 1 << 20
"""Bytes of a line that is read. Of longer ones no part is an event."""
_MAX_COMPLAINTS = 64 << 10
"""Bytes at the end of the standard error that are kept or searched."""
_MAX_SHOWN = 500
"""Characters of its last line that are shown."""
_RECOGNISE_SECONDS = 5.0
"""Seconds between two looks for a process that was found again, where that takes a process of its own (macOS)."""


def engine_command(*arguments: object, python: Path | None = None, module: str = "engine") -> list[str]:
    """Return the command line that runs a module of the engine, with the variables of `engine_environment`.

    Parameters
    ----------
    *arguments : object
        Arguments of the module, as text.
    python : Path, optional
        Another Python than that of this process.
    """
    return [str(python or sys.executable), "-m", module, *map(str, arguments)]


def engine_environment(
    environ: Mapping[str, str] | None = None, *, root: Path = CODE_ROOT, other_python: bool = False
) -> dict[str, str]:
    """Return the environment variables of a process of the engine.

    Parameters
    ----------
    environ : mapping, optional
        By default, those of this process.
    root : Path
        Folder that contains the engine's package: it comes first in PYTHONPATH.
    other_python : bool
        Whether the process has another Python than this one, e.g. than Blender's. It writes UTF-8 then, and gets none
        of the modules that this process finds.
    """
    kept = dict(os.environ if environ is None else environ)
    paths = [str(root), *filter(None, [kept.get("PYTHONPATH")])]
    if other_python:
        # Blender may set PYTHONHOME to its own Python; another interpreter cannot start with it.
        kept.pop("PYTHONHOME", None)
        kept, paths = with_utf8(kept), paths[:1]
    # PYTHONSAFEPATH: a file in the current folder must not pass for a module of ours.
    return {**kept, "PYTHONPATH": os.pathsep.join(paths), "PYTHONSAFEPATH": "1"}


def events_in(stream: IO[bytes]) -> Iterator[Event]:
    """Yield the events that a process of the engine writes to its standard output; other lines are passed over."""
    while line := stream.readline(_MAX_LINE):
        event = from_json_line(line.decode("utf-8", "replace"))
        if event is not None:
            yield event


class EngineProcess:
    """A process of the engine. `start` and `start_apart` start one; otherwise it is one of `start_apart`, found again.

    It leads a group of processes: no signal of this process's terminal reaches it, and what it started is killed with
    it. As a context it is `close`d at the end.

    Attributes
    ----------
    pid : int
    command : list of str
    started : int or None
        When it started, see `engine.core.system.start_time`.
    folder : Path or None
        Where its files are, see `STOP_FILE`.
    """

    def __init__(self, pid: int, command: Sequence[str], started: int | None, folder: Path | None) -> None:
        self.pid, self.command, self.started, self.folder = pid, list(command), started, folder
        self._process: subprocess.Popen[bytes] | None = None
        self._complaints = bytearray()
        self._readers: list[threading.Thread] = []
        self._kill_at: float | None = None
        self._recognised_at, self._recognised = -_RECOGNISE_SECONDS, True

    @classmethod
    def start(
        cls,
        command: Sequence[str],
        environment: Mapping[str, str],
        read: Callable[[IO[bytes]], None],
        *,
        folder: Path | None = None,
    ) -> EngineProcess:
        """Start a process with pipes. It should end when its standard input does, as that closes with this process.

        Parameters
        ----------
        environment : mapping
            Environment variables.
        read : callable
            Called in a thread with the standard output, which it reads to the end.
        folder : Path, optional
            For the file by which `stop` asks it to stop.

        Raises
        ------
        StartError
            When it cannot be started.
        """
        pipe = subprocess.PIPE
        run = cls._started(command, environment, folder, stdin=pipe, stdout=pipe, stderr=pipe)
        process = run._process
        assert process is not None and process.stdout is not None and process.stderr is not None
        for stream, function in ((process.stdout, read), (process.stderr, run._keep_complaints)):
            run._readers.append(threading.Thread(target=_read_and_close, args=(stream, function), daemon=True))
            run._readers[-1].start()
        return run

    @classmethod
    def start_apart(cls, command: Sequence[str], environment: Mapping[str, str], folder: Path) -> EngineProcess:
        """Start a process that goes on when this one ends. It works in `folder` and writes to files there.

        Raises
        ------
        DiskError
            When the files cannot be written, or, as `StartError`, the process cannot be started.
        """
        try:
            with (folder / EVENTS_FILE).open("wb") as events, (folder / ERRORS_FILE).open("wb") as errors:
                return cls._started(
                    command, environment, folder, cwd=folder, stdin=subprocess.DEVNULL, stdout=events, stderr=errors
                )
        except OSError as error:
            raise DiskError(f"{folder} cannot be written: {error.strerror or error}. Check the disk.") from error

    @classmethod
    def _started(
        cls, command: Sequence[str], environment: Mapping[str, str], folder: Path | None, **options: Any
    ) -> EngineProcess:
        asked_by = {} if folder is None else {STOP_VARIABLE: str(folder.absolute() / STOP_FILE)}
        try:
            process = subprocess.Popen(list(command), env={**environment, **asked_by}, **options, **own_group())
        except (OSError, ValueError) as error:  # ValueError: a null character in an argument
            reason = (isinstance(error, OSError) and error.strerror) or error
            where = "" if folder is None else f" in {folder}"
            raise StartError(f"{command[0]} could not be started{where}: {reason}. Check its path.") from error
        run = cls(process.pid, command, start_time(process.pid), folder)
        run._process = process
        return run

    def __enter__(self) -> EngineProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_found_again(self) -> bool:
        """Whether it is no child of this process."""
        return self._process is None

    @property
    def code(self) -> int | None:
        """Exit code as of the last `poll` or `wait`, negative for a signal; None while it runs or was found again."""
        return None if self._process is None else self._process.returncode

    def poll(self) -> bool:
        """Return whether it runs; kill it when the time of `kill_after` is over."""
        runs = self._is_alive()
        if runs and self._kill_at is not None and time.monotonic() > self._kill_at:
            self._kill_at = None
            self.kill()
        return runs

    def runs(self) -> bool | None:
        """Return whether it runs; None when the system does not report it."""
        if self._process is not None:
            return self._process.poll() is None
        return process_runs(self.pid, self.command, self.folder or Path(), self.started)

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until it has ended, for at most `seconds`, and return whether it has. Not for one that was found."""
        assert self._process is not None
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def send(self, data: bytes) -> bool:
        """Write to its standard input, and return whether it took everything. One that has ended does not."""
        assert self._process is not None and self._process.stdin is not None
        try:
            self._process.stdin.write(data)
            self._process.stdin.flush()
        except OSError:
            return False
        return True

    def stop(self) -> None:
        """Ask it to stop at its next safe point.

        Raises
        ------
        DiskError
            When its folder cannot be written.
        """
        assert self.folder is not None
        try:
            request_stop(self.folder / STOP_FILE)
        except OSError as error:
            raise DiskError(
                f"{self.folder} cannot be written: {error.strerror or error}. Check the disk, then cancel again."
            ) from error

    def kill_after(self, seconds: float) -> None:
        """Let `poll` kill it if it still runs after `seconds`."""
        self._kill_at = time.monotonic() + seconds

    def kill(self) -> None:
        """Kill it, and what it started. One that was found again is recognised first."""
        if self._process is not None:
            kill_group(self._process)
        else:
            kill_recognised(self.pid, self.command, self.folder or Path(), self.started)

    def close(self, grace_seconds: float = 0.0) -> None:
        """Close its input, give it `grace_seconds` to end, kill it with what it started, and read all that it wrote.

        Not for a process that was found again.
        """
        assert self._process is not None
        if grace_seconds:
            self._close_input()
            self.wait(grace_seconds)
        kill_group(self._process)
        self._process.wait()
        self._close_input()
        for reader in self._readers:
            reader.join()

    def complaints(self) -> str:
        """Return the end of its standard error."""
        data = bytes(self._complaints)
        if self.folder is not None and not self._readers:
            with contextlib.suppress(FormatError), opened(self.folder / ERRORS_FILE, advice="") as stream:
                stream.seek(max(0, stream.seek(0, os.SEEK_END) - _MAX_COMPLAINTS))
                data = stream.read(_MAX_COMPLAINTS)
        return data.decode("utf-8", "replace").strip()

    def last_complaint(self) -> str:
        """Return the last line of its standard error, at most 500 characters of it; empty if there is none."""
        lines = self.complaints().splitlines()
        return lines[-1].strip()[:_MAX_SHOWN] if lines else ""

    def _close_input(self) -> None:
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()

    def _is_alive(self) -> bool:
        if self._process is not None or is_cheap_to_recognise():
            return self.runs() is not False
        now = time.monotonic()
        if now - self._recognised_at >= _RECOGNISE_SECONDS:
            self._recognised_at, self._recognised = now, self.runs() is not False
        return self._recognised

    def _keep_complaints(self, stream: IO[bytes]) -> None:
        while chunk := os.read(stream.fileno(), _MAX_COMPLAINTS):
            self._complaints += chunk
            del self._complaints[:-_MAX_COMPLAINTS]


def _read_and_close(stream: IO[bytes], read: Callable[[IO[bytes]], None]) -> None:
    with stream:
        read(stream)
