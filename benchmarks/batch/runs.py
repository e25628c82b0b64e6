"""Batches as programs: started, measured from /proc, with their own scheduler and workers where they are killed."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from distributed import Client

from ..places import ROOT
from ..processes import cpu_of

_PROGRAM = """
import runpy, sys
from engine.core.system import end_with_parent
end_with_parent(sys.stdin.buffer)
runpy.run_module("distributed.cli." + sys.argv.pop(1), run_name="__main__", alter_sys=True)
"""
"""A program of Dask in a process that ends with this one, however this one ends."""


def batch_command(folders: Sequence[Path], out: Path, *options: str) -> list[str]:
    """Return the command line of a batch."""
    return [sys.executable, "-m", "engine", "batch", *map(str, folders), f"--out={out}", "--events", *options]


@dataclass
class Finished:
    """A batch that ran to its end.

    Attributes
    ----------
    code : int
    seconds : float
    own_cpu, all_cpu : float
        CPU seconds of the scheduler and client, which share a process, and of that with all workers and engines.
    summary : dict
    """

    code: int
    seconds: float
    own_cpu: float
    all_cpu: float
    summary: dict[str, Any]


def finished_batch(folders: Sequence[Path], out: Path, *options: str) -> Finished:
    """Run a batch with workers on this computer; its scheduler, client and nannies are one process."""
    begin, before = time.monotonic(), os.times()
    process = subprocess.Popen(
        batch_command(folders, out, *options), cwd=ROOT, stdout=subprocess.DEVNULL, env={**os.environ}
    )
    own = 0.0
    while process.poll() is None:
        own = max(own, cpu_of(process.pid))
        time.sleep(0.2)
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return Finished(process.returncode, time.monotonic() - begin, own, used, read_summary(out))


def read_summary(out: Path) -> dict[str, Any]:
    """Return what a batch wrote at its end."""
    summary: dict[str, Any] = json.loads((out / "batch.json").read_text(encoding="utf-8"))
    return summary


@dataclass
class Cluster:
    """A scheduler and workers as programs of their own, which can be killed.

    Attributes
    ----------
    folder : Path
        For logs and scratch files.
    preload : str
        Module that every worker imports, for an engine with short stages; empty: none.
    """

    folder: Path
    preload: str = ""
    port: int = 0
    scheduler: subprocess.Popen[bytes] | None = None
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)
    _alive: tuple[int, int] = field(default_factory=os.pipe)

    def start_scheduler(self) -> str:
        """Start the scheduler, again on the same port if it had one, and return its address."""
        self.folder.mkdir(parents=True, exist_ok=True)
        file = self.folder / "scheduler.json"
        file.unlink(missing_ok=True)
        words = ["--host=127.0.0.1", f"--port={self.port}", "--no-dashboard", f"--scheduler-file={file}"]
        self.scheduler = self._started("dask_scheduler", words)
        while True:
            try:
                address: str = json.loads(file.read_text())["address"]
                break
            except (OSError, ValueError, KeyError):
                time.sleep(0.1)
        self.port = int(address.rpartition(":")[2])
        return address

    @property
    def address(self) -> str:
        """Address of the scheduler."""
        return f"tcp://127.0.0.1:{self.port}"

    def start_worker(
        self, *, nanny: bool = True, threads: int = 1, environment: dict[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        """Start one worker with 6 GB."""
        words = [
            self.address,
            f"--nthreads={threads}",
            "--resources",
            "MEMORY=6e9",
            "--no-dashboard",
            "--memory-limit=0",
        ]
        words += [f"--local-directory={self.folder}", "--nanny" if nanny else "--no-nanny"]
        words += [f"--preload={self.preload}"] if self.preload else []
        worker = self._started("dask_worker", words, environment or {})
        self.workers.append(worker)
        return worker

    def _started(
        self, program: str, words: list[str], environment: dict[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        settings = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1000", "PYTHONPATH": str(ROOT)}
        with (self.folder / f"{program}.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-c", _PROGRAM, program, *words],
                cwd=ROOT, env={**os.environ, **settings, **(environment or {})}, stdin=self._alive[0], stdout=log,
                stderr=log, start_new_session=True,
            )  # fmt: skip

    def worker_processes(self) -> list[int]:
        """Return the process numbers of the workers that are connected."""
        with Client(self.address, timeout=60, set_as_default=False) as client:
            return sorted(client.run(os.getpid, on_error="ignore").values())

    def stop(self) -> None:
        """Kill everything that was started; nothing of it is kept."""
        for process in [*self.workers, *([self.scheduler] if self.scheduler else [])]:
            with contextlib.suppress(ProcessLookupError):
                # A nanny leads a group of its own, and its worker is in it.
                os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            process.wait()
        for end in self._alive:
            os.close(end)
