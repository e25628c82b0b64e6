"""Settings of a batch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.settings import require


@dataclass(frozen=True)
class BatchSettings:
    """Where the projects go, where the work is done, and what is tried again.

    Parameters
    ----------
    out : Path
        Folder that gets one project folder for each photo folder.
    arguments : tuple of str
        Options of ``reconstruct`` for every folder.
    scheduler : str
        Address of a Dask scheduler; empty: workers are started on this computer.
    workers, threads : int
        Workers on this computer, and cores of each; 0: chosen from its cores and memory.
    ship : bool
        Whether photos and project are sent with each task and the result is sent back, for workers that do not share
        the folders.
    gpu_stages : tuple of str
        Stages that reserve one unit of the worker resource ``GPU``.
    tries : int
        How often a stage is tried when a worker fails, not counting those that Dask repeats itself.
    photos_memory : int
        Bytes reserved for the first stage, whose forecast is not known yet.
    more_memory : float
        Factor on the reserved memory after the system killed an engine.
    busy_pause, busy_limit : float
        Seconds between two tries on a folder that another job is working in, and until it is given up.
    worker_wait : float
        Seconds to wait for a worker that has enough resources.
    scheduler_wait : float
        Seconds to wait for the scheduler.
    stop_wait : float
        Seconds that running stages have to stop.
    max_shipped_bytes : int
        Largest photo folder, and largest project, that is sent.
    """

    out: Path
    arguments: tuple[str, ...] = ()
    scheduler: str = ""
    workers: int = 0
    threads: int = 0
    ship: bool = False
    gpu_stages: tuple[str, ...] = ()
    tries: int = 3
    photos_memory: int = 1_000_000_000
    more_memory: float = 1.5
    busy_pause: float = 5.0
    busy_limit: float = 6 * 3600.0
    worker_wait: float = 120.0
    scheduler_wait: float = 300.0
    stop_wait: float = 60.0
    max_shipped_bytes: int = 2 << 30

    def __post_init__(self) -> None:
        require(self, "workers", self.workers >= 0, "0 or more")
        require(self, "threads", self.threads >= 0, "0 or more")
        require(self, "tries", self.tries >= 1, "at least 1")
