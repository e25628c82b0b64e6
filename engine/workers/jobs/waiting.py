"""Jobs that wait for the running one, kept as files so that they outlive Blender or the server. Does not import bpy."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import DiskError, FormatError, ProjectError
from ...core.files import path_within, read_json, write_json
from ...core.system import name_in_order

_RECORD = {"kind": str, "subject": str, "command": [str]}


@dataclass(frozen=True)
class WaitingJob:
    """A job that starts when the one before it has ended.

    Attributes
    ----------
    kind : str
        See `Job`.
    subject : Path
    command : tuple of str
    file : Path
        Its record.
    """

    kind: str
    subject: Path
    command: tuple[str, ...]
    file: Path

    def take(self) -> bool:
        """Delete the record, and return whether it was there: only one of several Blenders starts the job.

        Raises
        ------
        DiskError
            When it cannot be deleted.
        """
        try:
            self.file.unlink()
        except FileNotFoundError:
            return False
        except OSError as error:
            raise DiskError(f"{self.file} could not be deleted: {error.strerror or error}. Delete it.") from error
        return True


class WaitingJobs:
    """The queue of Blender or of a server. It iterates over its jobs, the next first.

    Parameters
    ----------
    folder : callable
        Returns the folder of the records, which exists.
    """

    def __init__(self, folder: Callable[[], Path]) -> None:
        self._folder = folder
        self._jobs: list[WaitingJob] = []

    def __iter__(self) -> Iterator[WaitingJob]:
        return iter(tuple(self._jobs))

    def __len__(self) -> int:
        return len(self._jobs)

    def find(self) -> None:
        """Add the jobs that an earlier session has stored, the oldest first. Files that are no records are left out."""
        folder, known = self._folder(), {one.file for one in self._jobs}
        for name in sorted(path.name for path in folder.glob("*.json")):
            try:
                file = path_within(folder, name)
                record = read_json(file, _RECORD, advice="Delete it.")
            except FormatError:
                continue
            if record["command"] and file not in known:
                self._jobs.append(WaitingJob(record["kind"], Path(record["subject"]), tuple(record["command"]), file))

    def has(self, kind: str, subject: Path, command: Sequence[str]) -> bool:
        """Return whether this job waits."""
        return any((one.kind, one.subject, one.command) == (kind, subject, tuple(command)) for one in self._jobs)

    def add(self, kind: str, subject: Path, command: Sequence[str], *, place: int | None = None) -> WaitingJob:
        """Store a job and return it.

        Parameters
        ----------
        kind, subject, command
            See `WaitingJob`.
        place : int, optional
            How many jobs come before it; by default all.

        Raises
        ------
        ProjectError
            When the same job waits already.
        DiskError
            When the folder cannot be written.
        """
        if self.has(kind, subject, command):
            raise ProjectError("The same job is waiting already.")
        folder = self._folder()
        file = folder / f"{name_in_order(path.name for path in folder.glob('*.json'))}.json"
        write_json(file, {"kind": kind, "subject": str(subject), "command": list(command)})
        job = WaitingJob(kind, subject, tuple(command), file)
        self._jobs.insert(len(self._jobs) if place is None else place, job)
        return job

    def next(self, busy: Collection[Path] = ()) -> WaitingJob | None:
        """Remove the first job whose subject is not `busy`, and return it, None when there is none.

        Its record stays until it is taken.
        """
        job = next((one for one in self._jobs if one.subject not in busy), None)
        if job is not None:
            self._jobs.remove(job)
        return job

    def drop(self, job: WaitingJob) -> None:
        """Remove a job, with its record.

        Raises
        ------
        DiskError
            When the record cannot be deleted.
        """
        self._jobs.remove(job)
        job.take()

    def forget(self) -> None:
        """Remove all jobs and leave their records, for `find`."""
        self._jobs.clear()
