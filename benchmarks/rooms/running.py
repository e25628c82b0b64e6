"""The resumable measuring run: renders, reconstructs and measures the rooms that have no result yet.

A method is used from a worktree of the commit that froze it, so that edits during the run cannot change it. Rooms are
rendered by the present working tree, the same for all methods.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from engine.core.errors import EnvironmentProblem, HeritageError, SettingsError
from engine.core.files import file_sha256, read_json, write_json
from engine.core.system import cpu_seconds

from .draws import Room
from .repository import Repository
from .results import SHORT, read_measured, read_result, write_result

_STOP_SECONDS = 30
"""How long a command may take to end after it was told to."""
_LOG_TAIL = 4000
_TIME = {"wall": float, "cpu": float, "whole": bool}


class Call(Protocol):
    """Runs a command."""

    def __call__(self, command: Sequence[str], *, folder: Path, log: Path) -> None:
        """Run `command` in `folder`, its output into `log`; raises `HeritageError` when it fails."""


def run_command(command: Sequence[str], *, folder: Path, log: Path) -> None:
    """Run a command, its output appended to `log`. It ends with this process, unless this process is killed.

    Raises
    ------
    HeritageError
        When it fails, with the last line of its output.
    EnvironmentProblem
        When the program does not exist.
    """
    # The command must import the packages of `folder`, not those of another working tree.
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("ab") as stream:
        begin = stream.tell()
        try:
            process = subprocess.Popen(
                [*command], cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=stream, stderr=stream
            )
        except FileNotFoundError as error:
            raise EnvironmentProblem(f"{command[0]} does not exist. Run `make setup`, then run again.") from error
        try:
            code = process.wait()
        except BaseException:
            process.terminate()
            try:
                process.wait(_STOP_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
            raise
    if code:
        raise HeritageError(f"{_last_line(log, begin)} The whole output is in {log}.")


def _last_line(log: Path, begin: int) -> str:
    """Return the last line that was written to `log` behind `begin`, as a sentence."""
    with log.open("rb") as stream:
        stream.seek(max(begin, log.stat().st_size - _LOG_TAIL))
        lines = stream.read().decode("utf-8", "replace").split("\n")
    line = next((line.strip() for line in reversed(lines) if line.strip()), "The command failed without a message.")
    return line if line.endswith(".") else f"{line}."


def is_rendered(folder: Path) -> bool:
    """Return whether a folder holds all photos of a room with its ground truth."""
    try:
        cameras = read_json(folder / "truth" / "cameras.json", {"photos": [{"file": str}]}, advice="")
    except HeritageError:
        return False
    photos = [Path(photo["file"]) for photo in cameras["photos"]]
    needed = [folder / "photos" / photo.name for photo in photos]
    needed += [folder / "truth" / "masks" / f"{photo.stem}.png" for photo in photos]
    needed += [folder / "truth" / "names.json", folder / "truth" / "absent.json", folder / "cameras" / "images.txt"]
    return all(file.is_file() for file in needed)


def pictures_sha256(folder: Path) -> str:
    """Return a hash of the photos and the ground truth of a room: equal only for the very same pictures."""
    digest = hashlib.sha256()
    for file in sorted(path for part in ("photos", "truth") for path in (folder / part).rglob("*") if path.is_file()):
        digest.update(f"{file.relative_to(folder).as_posix()} {file_sha256(file)}\n".encode())
    return digest.hexdigest()


def _print(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


@dataclass
class MeasuringRun:
    """Measures rooms with frozen methods. Everything that is done is kept, wherever the run ends.

    Attributes
    ----------
    repository : Repository
        Where the results are stored, and the rooms rendered, below ``out/rooms``.
    blender, engine : str
        Python interpreters of the Blender environment and of the engine's.
    call : Call
        Runs commands.
    say : callable
        Shows a line of progress.
    models : Path or None
        Folder of the 3D models that rooms with `Room.of_models` show.
    """

    repository: Repository
    blender: str
    engine: str
    call: Call = run_command
    say: Callable[[str], None] = _print
    models: Path | None = None
    _begin: float = field(default_factory=time.monotonic)

    def measure(self, commits: Sequence[str], rooms: Sequence[Room]) -> list[dict[str, Any]]:
        """Measure every room with every method that has no result yet, and return the new results.

        Parameters
        ----------
        commits : sequence of str
            Full hashes of the commits that froze the methods.
        rooms : sequence of Room

        Raises
        ------
        HeritageError
            When a step fails.
        """
        root = self.repository.root
        missing = [(room, one) for room in rooms for one in commits if read_result(root, one, room.name) is None]
        n_known = len(rooms) * len(commits) - len(missing)
        self._tell(f"{n_known} results are stored, {len(missing)} are missing")
        made = []
        for number, (room, commit) in enumerate(missing, 1):
            made.append(self._measure_room(room, commit, f"{number} of {len(missing)}, {room.name}"))
        return made

    def _measure_room(self, room: Room, commit: str, what: str) -> dict[str, Any]:
        folder = self._out / room.name
        rendered = self._render(room, folder, what)
        tree = self.repository.worktree(self._out / "methods" / commit[:SHORT], commit)
        work = folder / commit[:SHORT]
        project, measured, log = work / "project", work / "measured.json", work / "log.txt"
        command = [self.engine, "-m", "benchmarks.rooms"]
        self._tell(f"{what}: reconstructing with {commit[:SHORT]}")
        self.call([*command, "reconstruct", str(folder), "--out", str(project)], folder=tree, log=log)
        self._tell(f"{what}: measuring")
        truth = folder / "truth"
        self.call([*command, "measure", str(project), str(truth), "--out", str(measured)], folder=tree, log=log)
        result = {
            "room": room.name,
            "seed": room.seed,
            "commit": commit,
            "pictures": pictures_sha256(folder),
            **({"rendered": rendered} if rendered else {}),
            **read_measured(measured),
        }
        write_result(self.repository.root, result)
        self._tell(f"{what}: done")
        return result

    def render(self, rooms: Sequence[Room]) -> None:
        """Render the photos and the ground truth of rooms into ``out/rooms``; those that are there stay.

        Raises
        ------
        HeritageError
            When a room cannot be rendered.
        """
        for room in rooms:
            self._render(room, self._out / room.name, room.name)
            self._tell(f"{room.name}: rendered")

    def _render(self, room: Room, folder: Path, what: str) -> dict[str, Any] | None:
        """Render a room unless it is there; return the seconds, None when an earlier run did not note them."""
        noted = folder / "rendered.json"
        if not is_rendered(folder):
            self._tell(f"{what}: rendering")
            whole = not folder.exists()
            wall, cpu = time.perf_counter(), cpu_seconds()
            script = self.repository.root / "demo" / "random_rooms" / "make_photos.py"
            command = [self.blender, str(script), "--seed", str(room.seed), "--out", str(folder)]
            if room.of_models:
                command += ["--models", str(self._models_of(room))]
            self.call(command, folder=self.repository.root, log=self._out / f"{room.name}.log")
            if not is_rendered(folder):
                raise HeritageError(f"{folder} lacks photos or masks after it was rendered. Delete it, then run again.")
            seconds = {"wall": time.perf_counter() - wall, "cpu": cpu_seconds() - cpu, "whole": whole}
            write_json(noted, seconds)
        if not noted.exists():
            return None
        found: dict[str, Any] = read_json(noted, _TIME, advice="Delete it, then run again.")
        return found

    def _models_of(self, room: Room) -> Path:
        if self.models is None:
            raise SettingsError(
                f"{room.name} shows 3D models of other people. Name the folder with --models: Debian's package "
                "sweethome3d-furniture has them in usr/share/sweethome3d/furniture."
            )
        return self.models.resolve()

    @property
    def _out(self) -> Path:
        return self.repository.root / "out" / "rooms"

    def _tell(self, text: str) -> None:
        self.say(f"[{(time.monotonic() - self._begin) / 60:6.1f} min] {text}")
