"""The installed environment: where it is, whether it fits this version of the engine, and how it is removed."""

from __future__ import annotations

import contextlib
import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ...core.errors import DiskError, FormatError, ProjectError
from ...core.files import delete_derived, read_json, read_text, write_json
from ...core.system import engine_folder, python_in
from .locked import fingerprint, locked_file

FOLDER_VARIABLE = "GAUSSIAN_HERITAGE_ENGINE"
"""Environment variable with the folder of the installed engine."""

State = Literal["missing", "incomplete", "outdated", "ready"]

_STAMP, _MARK, _VENV = "installed.json", "gaussian_heritage_engine.txt", "pyvenv.cfg"
_SCHEMA = {"made_from": str, "python": str, "torch": str}
_MARK_TEXT = "The Python environment of Gaussian Heritage's engine. Remove it in Blender's preferences.\n"


def default_folder() -> Path:
    """Return the folder for the engine in the user's data folder; ``GAUSSIAN_HERITAGE_ENGINE`` names another one.

    It is the same for all versions of Blender, and no upgrade of Blender or of the extension deletes it.
    """
    if configured := os.environ.get(FOLDER_VARIABLE):
        return Path(configured)
    return engine_folder()


@dataclass(frozen=True)
class EngineEnvironment:
    """The environment in a folder, which need not exist yet.

    Attributes
    ----------
    folder : Path
        Contains the virtual environment ``env``, and the log ``installation.log``.
    """

    folder: Path

    @property
    def root(self) -> Path:
        """The virtual environment."""
        return self.folder / "env"

    @property
    def python(self) -> Path:
        """Its interpreter."""
        return python_in(self.root)

    @property
    def removal_folder(self) -> Path:
        """Where the job that deletes the engine works: beside it, in no folder that is deleted meanwhile."""
        return self.folder.with_name(f"{self.folder.name}-removal")

    @property
    def log(self) -> Path:
        """The output of pip and of the other programs."""
        return self.folder / "installation.log"

    def state(self) -> State:
        """Return whether the engine can run here.

        "incomplete" after an installation that was stopped or failed, or when the Python that it is made from is gone,
        as after an update of Blender, "outdated" when another version of the engine,
        with other requirements, made it. Blender asks at each redraw, so files are only read again after a change:
        reading may wait for a disk that a job is writing to.
        """
        return _state(self, self._changed())

    def _changed(self) -> tuple[int, ...]:
        """Return numbers that differ whenever `state` may have changed."""
        own = [self.folder / _MARK, self.folder / _STAMP, self.python, self.root / _VENV]
        times = [_time_of(file) for file in own]
        return (*times, *(_time_of(folder) for folder in _base_of(self.root, times[-1])))

    def begin(self) -> None:
        """Mark the folder as ours and as incomplete.

        Raises
        ------
        ProjectError
            When the folder has other content, which an installation would mix with.
        DiskError
            When the folder cannot be written.
        """
        try:
            if not (self.folder / _MARK).is_file():
                if self.folder.exists() and any(self.folder.iterdir()):
                    raise ProjectError(
                        f"{self.folder} is not empty and not an engine of Gaussian Heritage. Choose another folder."
                    )
                self.folder.mkdir(parents=True, exist_ok=True)
                (self.folder / _MARK).write_text(_MARK_TEXT, encoding="utf-8")
            delete_derived(self.folder, _STAMP)
        except OSError as error:
            raise _cannot_be_changed(self.folder, error) from error

    def finish(self, python: str, build: str) -> None:
        """Record that the environment is complete: with this version of Python, and this build of torch.

        Raises
        ------
        DiskError
            When the folder cannot be written.
        """
        write_json(self.folder / _STAMP, {"made_from": _fingerprint(python, build), "python": python, "torch": build})

    def remove(self) -> None:
        """Delete the folder.

        Raises
        ------
        ProjectError
            When it is not an engine that was installed here, or is in use.
        DiskError
            When it cannot be deleted.
        """
        if not (self.folder / _MARK).is_file() or self.folder.is_symlink():
            raise ProjectError(f"{self.folder} contains no engine of Gaussian Heritage, so nothing was deleted.")
        # The mark last: a removal that was stopped can be repeated.
        for name in [_STAMP, *(entry.name for entry in self.folder.iterdir() if entry.name != _MARK), _MARK]:
            delete_derived(self.folder, name)
        with contextlib.suppress(OSError):
            self.folder.rmdir()


@functools.lru_cache(maxsize=4)
def _state(engine: EngineEnvironment, changed: tuple[int, ...]) -> State:
    if not (engine.folder / _MARK).is_file():
        return "missing"
    try:
        stamp = read_json(engine.folder / _STAMP, _SCHEMA, advice="")
    except FormatError:
        return "incomplete"
    if not engine.python.is_file() or not all(folder.is_dir() for folder in _base_of(engine.root, changed[3])):
        return "incomplete"
    current = stamp["made_from"] == _fingerprint(stamp["python"], stamp["torch"])
    return "ready" if current else "outdated"


@functools.lru_cache(maxsize=4)
def _base_of(environment: Path, changed: int) -> tuple[Path, ...]:
    """Return the folder of the Python that an environment was made from; empty when it is not stated.

    On Windows the environment's own interpreter is a program that starts that one: its file alone proves nothing.
    """
    try:
        text = read_text(environment / _VENV, advice="")
    except FormatError:
        return ()
    entries = (line.partition("=") for line in text.splitlines())
    return tuple(Path(value.strip()) for name, sign, value in entries if sign and name.strip() == "home")


def _time_of(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _fingerprint(python: str, build: str) -> str:
    return fingerprint(python, build, [locked_file(name) for name in ("engine", "torch", "cuda")])


def _cannot_be_changed(folder: Path, error: OSError) -> DiskError:
    where = error.filename or folder
    return DiskError(
        f"{where} cannot be changed: {error.strerror or error}. Close programs that use the engine, check the disk and "
        "permissions, and try again."
    )
