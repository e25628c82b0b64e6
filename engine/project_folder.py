"""The project folder: a killed run leaves it intact, and the next run continues it.

Every file is written under a temporary name and renamed; a stage counts as done only when its key (a hash of
everything that it read) is in ``project.json``. A lock admits one writer at a time. Standard library and NumPy only:
Blender reads project folders too.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from .errors import DiskError, FormatError, ProjectError
from .files import TEMPORARY_PREFIX, finite_or_null, require_no_links_out, write_json

__all__ = ["PROJECT_FILE", "PROJECT_VERSION", "ProjectFolder", "stage_key"]

PROJECT_VERSION = 1
PROJECT_FILE = "project.json"
_LOCK_FILE = "lock"


def stage_key(*parts: Any) -> str:
    """Return the SHA-256 of `parts` (JSON values): settings, file hashes and the keys of earlier stages."""
    text = json.dumps(parts, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


class ProjectFolder:
    """A project folder.

    Parameters
    ----------
    path : Path
        The folder. Use `create` or `open_existing` instead of the constructor.

    Notes
    -----
    Layout: ``project.json``, ``photos/``, ``cameras/``, ``masks/``, ``gaussians/scene.ply`` and ``features.npy``,
    ``checkpoints/``, ``groups/`` (cache; made by the first text prompt), ``objects/<id>/``, ``report/``, ``log.jsonl``.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._data: dict[str, Any] = {"version": PROJECT_VERSION, "stages": {}}
        self._lock: IO[str] | None = None

    @classmethod
    def create(cls, path: Path) -> ProjectFolder:
        """Return the project at `path`, which is created when there is none.

        Raises
        ------
        ProjectError
            When `path` is a file, or a folder that holds other files.
        DiskError
            When it cannot be written.
        """
        project = cls(path)
        if (path / PROJECT_FILE).exists():
            project._read()
            return project
        if path.exists() and not path.is_dir():
            raise ProjectError(f"{path} is a file. Choose a folder for the project.")
        ours = (_LOCK_FILE, "log.jsonl")
        if path.exists() and any(
            entry.name not in ours and not entry.name.startswith(TEMPORARY_PREFIX) for entry in path.iterdir()
        ):
            raise ProjectError(
                f"{path} already holds files that are not a Gaussian Heritage project. Choose an empty or new folder."
            )
        project._write()
        return project

    @classmethod
    def open_existing(cls, path: Path) -> ProjectFolder:
        """Return the project at `path`.

        Raises
        ------
        ProjectError
            When `path` is not a project.
        """
        if not (path / PROJECT_FILE).is_file():
            raise ProjectError(f"{path} is not a Gaussian Heritage project (it has no {PROJECT_FILE}).")
        project = cls(path)
        project._read()
        return project

    def _read(self) -> None:
        file = self.path / PROJECT_FILE
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, json.JSONDecodeError) as error:
            raise FormatError(f"{file} cannot be read: {error}. Use a new folder for the scene.") from error
        if not (
            isinstance(data, dict) and isinstance(data.get("stages"), dict) and data.get("version") == PROJECT_VERSION
        ):
            raise FormatError(f"{file} was written by another version of Gaussian Heritage. Use a new folder.")
        self._data = data

    def _write(self) -> None:
        write_json(self.path / PROJECT_FILE, self._data)

    def __enter__(self) -> ProjectFolder:
        """Lock the folder for writing and delete temporary files that a killed run left.

        Raises
        ------
        ProjectError
            When another job holds the lock.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            require_no_links_out(self.path)
            # Held open until __exit__; the operating system releases the lock even after kill -9.
            stream = (self.path / _LOCK_FILE).open("a+", encoding="utf-8")
        except OSError as error:
            raise DiskError(
                f"{self.path} cannot be written: {error.strerror or error}. Choose another folder."
            ) from error
        if not _try_lock(stream):
            stream.close()
            raise ProjectError(
                f"Another job is working in {self.path}. Wait for it, cancel it, or choose another folder."
            )
        self._lock = stream
        if (self.path / PROJECT_FILE).exists():
            # Another job may have finished after the folder was read and before it was locked.
            self._read()
        for leftover in self.path.rglob(TEMPORARY_PREFIX + "*"):
            leftover.unlink(missing_ok=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def get(self, name: str, default: Any = None) -> Any:
        """Return the value stored in ``project.json`` under `name`."""
        return self._data.get(name, default)

    def put(self, name: str, value: Any) -> None:
        """Store a JSON value in ``project.json`` under `name`."""
        self._data[name] = value
        self._write()

    def stage_is_done(self, stage: str, key: str) -> bool:
        """Return whether `stage` was finished with exactly this `key`."""
        return bool(self._data["stages"].get(stage, {}).get("key") == key)

    def stage_record(self, stage: str) -> dict[str, Any] | None:
        """Return what `finish_stage` stored for `stage`; None when the stage is not done."""
        record: dict[str, Any] | None = self._data["stages"].get(stage)
        return record

    def finish_stage(
        self,
        stage: str,
        key: str,
        *,
        wall_seconds: float,
        cpu_seconds: float,
        figures: dict[str, Any],
        peak_memory: int | None = None,
        continued: bool = False,
    ) -> None:
        """Record that `stage` is done with `key`.

        Parameters
        ----------
        stage, key : str
        wall_seconds, cpu_seconds : float
            Time that the finishing run spent on the stage.
        figures : dict
            Results for the report; numbers that are not finite are stored as null.
        peak_memory : int or None
            Peak memory of the process in bytes, None where the system does not report it.
        continued : bool
            Whether an earlier run had begun the stage, so that the seconds cover only a part of it.
        """
        self._data["stages"][stage] = {
            "key": key,
            "wall_seconds": wall_seconds,
            "cpu_seconds": cpu_seconds,
            "peak_memory": peak_memory,
            "continued": continued,
            "figures": finite_or_null(figures),
        }
        self._write()

    def forget_stages(self, stages: list[str]) -> None:
        """Mark `stages` as not done."""
        if any(stage in self._data["stages"] for stage in stages):
            for stage in stages:
                self._data["stages"].pop(stage, None)
            self._write()


def _lock_function() -> Callable[[IO[str]], None]:
    try:
        import fcntl
    except ImportError:
        import msvcrt

        def lock_windows(stream: IO[str]) -> None:
            stream.seek(0)
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]

        return lock_windows

    def lock_posix(stream: IO[str]) -> None:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)

    return lock_posix


def _try_lock(stream: IO[str]) -> bool:
    try:
        _lock_function()(stream)
    except OSError:
        return False
    return True
