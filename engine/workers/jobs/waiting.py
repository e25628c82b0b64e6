"""Jobs that wait for the running one, kept as files so that they outlive Blender. Does not import bpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import DiskError, FormatError
from ...core.files import path_within, read_json, write_json
from ...core.system import name_in_order

__all__ = ["WaitingJob"]

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

    @classmethod
    def store(cls, folder: Path, kind: str, subject: Path, command: Sequence[str]) -> WaitingJob:
        """Write the record of a job into `folder`.

        Raises
        ------
        DiskError
            When the folder cannot be written.
        """
        file = folder / f"{name_in_order(path.name for path in folder.glob('*.json'))}.json"
        write_json(file, {"kind": kind, "subject": str(subject), "command": list(command)})
        return cls(kind, subject, tuple(command), file)

    @classmethod
    def stored(cls, folder: Path) -> list[WaitingJob]:
        """Return the jobs whose records are in `folder`, the oldest first. Files that are no records are left out."""
        jobs = []
        for name in sorted(path.name for path in folder.glob("*.json")):
            try:
                file = path_within(folder, name)
                record = read_json(file, _RECORD, advice="Delete it.")
            except FormatError:
                continue
            if record["command"]:
                jobs.append(cls(record["kind"], Path(record["subject"]), tuple(record["command"]), file))
        return jobs

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
