"""The objects of a project: their folders, and their records by id or name. No arrays are read."""

from __future__ import annotations

import difflib
from pathlib import Path

from ...core.errors import ObjectError
from ...core.files import object_file
from .object_record import RECORD_FILE, ObjectRecord, read_record


def object_ids(project: Path) -> list[str]:
    """Return the ids of the objects of a project: the names of the folders that hold a record. No record is read."""
    return sorted(file.parent.name for file in (project / "objects").glob(f"*/{RECORD_FILE}"))


def taken_ids(project: Path) -> list[str]:
    """Return the names of folders that a new object must not have: those in use, also without a record."""
    # A folder without a record may still hold what the user wrote about an object. An empty one is left by a kill.
    folders = (path for path in (project / "objects").glob("*") if path.is_dir())
    return [folder.name for folder in folders if any(folder.iterdir())]


def list_objects(project: Path) -> list[ObjectRecord]:
    """Return the objects of the project folder `project`, oldest first."""
    records = (read_record(object_file(project, name, RECORD_FILE)) for name in object_ids(project))
    return sorted(records, key=lambda record: (record.created, record.id))


def load_object(project: Path, name: str) -> ObjectRecord:
    """Return the object with the id `name`, else the one with that name, else the one with it in another case.

    Raises
    ------
    ObjectError
        When the project has no object, or none of that name; the message names what is near.
    """
    records = list_objects(project)
    if not records:
        raise ObjectError(f"{project} has no objects yet. Isolate one with `segment` first.")
    folded = name.casefold()
    # Of equally good ones, the oldest.
    found = min(records, key=lambda one: (one.id != name, one.name != name, one.name.casefold() != folded))
    if name in (found.id, found.name) or folded == found.name.casefold():
        return found
    names = [record.name for record in records]
    near = difflib.get_close_matches(name, names)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise ObjectError(f"No object is called {name!r}.{hint} Known: {', '.join(names)}.")
