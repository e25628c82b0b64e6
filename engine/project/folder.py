"""The project folder: a killed run leaves it intact, and the next run continues it.

Every file is written under a temporary name and renamed; a stage counts as done only when its key (a hash of
everything that it read) is in ``project.json``. A lock admits one writer at a time. Standard library and NumPy only:
Blender reads project folders too.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import socket
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import IO, Any

from ..core.errors import DiskError, FormatError, ProjectError, ProjectInUse
from ..core.files import (
    TEMPORARY_PREFIX,
    FileRecord,
    delete_derived,
    finish_replacements,
    finite_or_null,
    is_as_recorded,
    path_within,
    read_versioned,
    record_of,
    require_no_links_out,
    write_json,
)
from ..core.system import try_lock
from ..core.visible_text import visible
from .versions import PROJECT_SCHEMA, PROJECT_VERSION

PROJECT_FILE = "project.json"
SCENE_OUTPUT = "gaussians/scene.ply"
"""Output of training that the objects refer to, as `ProjectFolder.recorded_outputs` names it."""

_LOCK_FILE = "lock"
_MAX_LOCK_BYTES = 300
"""Size of a lock with the longest name of a computer."""
_OURS = (_LOCK_FILE, "log.jsonl", "trash")
"""Names that a folder without ``project.json`` may hold and still become a project."""


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
    ``checkpoints/``, ``groups/`` (cache; made by the first text prompt), ``objects/<id>/``, ``report/``, ``trash/``,
    ``log.jsonl``.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._data: dict[str, Any] = {"version": PROJECT_VERSION, "stages": {}, "earlier_outputs": {}}
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
        if path.exists() and any(
            entry.name not in _OURS and not entry.name.startswith(TEMPORARY_PREFIX) for entry in path.iterdir()
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
        FormatError
            When its ``project.json`` is damaged or of a format number that is not known.
        """
        if not (path / PROJECT_FILE).is_file():
            raise ProjectError(f"{path} is not a Gaussian Heritage project (it has no {PROJECT_FILE}).")
        project = cls(path)
        project._read()
        return project

    def _read(self) -> None:
        file = self.path / PROJECT_FILE
        self._data = read_versioned(
            file, PROJECT_SCHEMA, version=PROJECT_VERSION, advice="Use a new folder for the scene."
        )

    def _write(self) -> None:
        write_json(self.path / PROJECT_FILE, self._data)

    def __enter__(self) -> ProjectFolder:
        """Lock the folder for writing, finish replacing files where a killed run began to, delete its temporary files.

        Raises
        ------
        ProjectInUse
            When another job holds the lock, of this computer or of another one on a shared disk.
        DiskError
            When the folder cannot be written or locked.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            require_no_links_out(self.path)
            stream = _open_locked(self.path / _LOCK_FILE)
        except OSError as error:
            raise DiskError(
                f"{self.path} cannot be written: {error.strerror or error}. Choose another folder."
            ) from error
        if stream is None:
            where = _holder(self.path / _LOCK_FILE)
            raise ProjectInUse(
                f"Another job is working in {self.path}{where}. Wait for it, cancel it, or choose another folder."
            )
        self._lock = stream
        _name_holder(stream)
        if (self.path / PROJECT_FILE).exists():
            # Another job may have finished after the folder was read and before it was locked.
            self._read()
        try:
            finish_replacements(self.path)
            for leftover in list(self.path.rglob(TEMPORARY_PREFIX + "*")):
                delete_derived(self.path, str(leftover.relative_to(self.path)))
        except BaseException:
            self.__exit__(None, None, None)
            raise
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
        outputs: Iterable[Path] = (),
        run: dict[str, Any] | None = None,
    ) -> None:
        """Record that `stage` is done with `key`.

        Parameters
        ----------
        wall_seconds, cpu_seconds : float
            Time that the finishing run spent on the stage.
        figures : dict
            Results for the report; numbers that are not finite are stored as null.
        peak_memory : int or None
            Peak memory of the process in bytes, None where the system does not report it.
        continued : bool
            Whether an earlier run had done a part of the stage, so that the seconds cover only the rest.
        outputs : iterable of Path
            Files that the stage made; their size and SHA-256 are recorded.
        run : dict, optional
            What ran, see `engine.project.provenance.describe_run`; None where it is not known.

        Raises
        ------
        FormatError
            When an output is missing.
        """
        self._data["stages"][stage] = {
            "key": key,
            "wall_seconds": wall_seconds,
            "cpu_seconds": cpu_seconds,
            "peak_memory": peak_memory,
            "continued": continued,
            "figures": finite_or_null(figures),
            "outputs": {self._name_of(path): record_of(path) for path in outputs},
            "run": None if run is None else finite_or_null(run),
        }
        self._data["earlier_outputs"].pop(stage, None)
        self._write()

    def forget_stages(self, stages: Iterable[str]) -> None:
        """Mark `stages` as not done. What is recorded of their outputs is kept until they are done again."""
        forgotten = {stage: self._data["stages"].pop(stage) for stage in stages if stage in self._data["stages"]}
        for stage, record in forgotten.items():
            self._data["earlier_outputs"][stage] = record["outputs"]
        if forgotten:
            self._write()

    def recorded_outputs(self, stage: str) -> dict[str, FileRecord]:
        """Return what is recorded of the outputs of `stage`, by path relative to the project.

        Of a stage that is not done any more, these are the outputs that it had; empty when nothing is recorded.
        """
        record = self._data["stages"].get(stage)
        outputs = self._data["earlier_outputs"].get(stage, {}) if record is None else record["outputs"]
        return dict(outputs)

    def record_outputs(self, stage: str, outputs: Iterable[Path]) -> None:
        """Record size and SHA-256 of more outputs of `stage`, which must be done; raises as `finish_stage` does."""
        record = self._data["stages"][stage]
        record["outputs"] = {**record["outputs"], **{self._name_of(path): record_of(path) for path in outputs}}
        self._write()

    def damaged_outputs(self, stage: str) -> dict[str, str]:
        """Return the outputs of `stage` that are not as recorded, with ``"is missing"`` or ``"was damaged"``."""
        found = {}
        for name, record in self.recorded_outputs(stage).items():
            path = path_within(self.path, *PurePosixPath(name).parts)
            if not is_as_recorded(path, record):
                found[name] = "was damaged" if path.exists() else "is missing"
        return found

    def require_intact(self, *stages: str) -> None:
        """Check the recorded outputs of `stages` before they are used; other files are checked by their readers.

        Raises
        ------
        ProjectError
            When a run that makes an output anew was stopped.
        FormatError
            When an output is missing or damaged.
        """
        for stage in stages:
            if stage in self._data["earlier_outputs"]:
                raise ProjectError(
                    f"The stage {stage!r} of {self.path} was begun again and is not finished. Run `reconstruct` again, "
                    "which continues it."
                )
            for name, problem in self.damaged_outputs(stage).items():
                raise FormatError(f"{self.path / name} {problem}. Run `reconstruct` again, which makes it again.")

    def _name_of(self, path: Path) -> str:
        return path.relative_to(self.path).as_posix()


def hold_mark(file: Path) -> IO[str] | None:
    """Hold the file `file`, which is made, until the returned stream is closed or this program ends.

    Returns
    -------
    file or None
        None when another program holds it.

    Raises
    ------
    DiskError
        When the file cannot be made.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        return _open_locked(file)
    except OSError as error:
        raise DiskError(f"{file} cannot be written: {error.strerror or error}. Check its permissions.") from error


def _open_locked(file: Path) -> IO[str] | None:
    """Return `file` opened and locked until it is closed, even by kill -9; None when another program holds it."""
    stream = file.open("a+", encoding="utf-8")
    try:
        if try_lock(stream):
            return stream
    except OSError:
        stream.close()
        raise
    stream.close()
    return None


def _name_holder(stream: IO[str]) -> None:
    """Write this computer and process into a lock, for those who find it held."""
    # Nothing depends on it.
    with contextlib.suppress(OSError):
        state = os.fstat(stream.fileno())
        if state.st_nlink > 1 or state.st_size > _MAX_LOCK_BYTES:
            # In a project of someone else, the name may lead to any file.
            return
        stream.truncate(0)
        stream.write(f"{socket.gethostname()} {os.getpid()}\n")
        stream.flush()


def _holder(lock: Path) -> str:
    """Return where the program runs that holds a lock, as the end of a clause; empty for this computer or unknown."""
    # Windows reads no file that is locked.
    with contextlib.suppress(OSError, ValueError):
        with lock.open(encoding="utf-8") as stream:
            host = visible(stream.readline(_MAX_LOCK_BYTES).partition(" ")[0].strip())
        return f" on the computer {host}" if host not in ("", socket.gethostname()) else ""
    return ""
