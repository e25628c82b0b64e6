"""The trash of a project: what a user made goes to ``trash/<time>-<id>/`` before it is deleted or replaced.

An entry is the object's folder, ``object/``, and ``trash.json`` with its name and why it is there. What changes the
trash takes a project that is open for writing, and raises `DiskError` when a file cannot be changed.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from ...core.errors import DiskError, FormatError, ObjectError
from ...core.files import (
    TEMPORARY_PREFIX,
    bytes_of,
    delete_derived,
    object_file,
    optional,
    path_within,
    read_json,
    replace_together,
    write_json,
)
from ...core.system import replace_file
from ..folder import SCENE_OUTPUT, ProjectFolder
from .museum_record import MUSEUM_RECORD_FILE
from .object_record import (
    COMPUTED_FILES,
    RECORD_FILE,
    ObjectRecord,
    new_id,
    new_name,
    read_record,
    recorded_files,
    write_record,
)
from .state_digest import state_of
from .stored_objects import list_objects, load_object, object_ids, taken_ids

_TRASH, _OBJECT, _INFO = "trash", "object", "trash.json"
_VERSION = 1
_SCHEMA = {"version": int, "id": str, "name": str, "deleted": str, "why": str, "scene": optional((str, None))}


@dataclass(frozen=True)
class Trashed:
    """An object in the trash: what it was called, when, with a time zone, and why it was moved there.

    `scene` is the SHA-256 of its scene, None where that is not known, and `n_bytes` the size of its files.
    """

    folder: Path
    id: str
    name: str
    deleted: datetime
    why: str
    scene: str | None
    n_bytes: int


def delete_object(project: ProjectFolder, name: str, *, why: str) -> ObjectRecord:
    """Move the object with that id or name to the trash, whose list says `why`, and return its record.

    Raises `ObjectError` when there is none.
    """
    record = load_object(project.path, name)
    discard_object(project, record.id, why=why)
    return record


def discard_object(project: ProjectFolder, object_id: str, *, why: str) -> None:
    """Do the same as `delete_object` with the object of that id, also when its record is damaged."""
    entry = _new_entry(project, object_id, why)
    # One rename: after a kill the object is in its place, and the entry without it counts for nothing, or in the trash.
    _move(path_within(project.path, "objects", object_id), entry / _OBJECT)


def keep_version(project: ProjectFolder, object_id: str, *, why: str) -> None:
    """Copy an object to the trash before it is changed; parameters and errors as of `discard_object`."""
    entry, source = _new_entry(project, object_id, why), path_within(project.path, "objects", object_id)
    copy = entry / f"{TEMPORARY_PREFIX}{_OBJECT}"
    try:
        shutil.copytree(source, copy, ignore=shutil.ignore_patterns(".*"), symlinks=True)
    except (OSError, shutil.Error) as error:
        raise DiskError(f"Could not copy {object_id} to {entry}: {error}. Free some space, then run again.") from error
    _move(copy, entry / _OBJECT)


def _new_entry(project: ProjectFolder, object_id: str, why: str) -> Path:
    """Make an entry without content and return its folder."""
    if object_id not in object_ids(project.path):
        raise ObjectError(f"{project.path} has no object with the id {object_id!r}.")
    try:
        name = read_record(object_file(project.path, object_id, RECORD_FILE)).name
    except FormatError:
        name = object_id
    now, trash = datetime.now(UTC), path_within(project.path, _TRASH)
    entry = path_within(trash, new_name(f"{now:%Y%m%d-%H%M%S}-{object_id}", [path.name for path in trash.glob("*")]))
    info = {"id": object_id, "name": name, "deleted": now.isoformat(), "why": why, "scene": _scene(project)}
    write_json(entry / _INFO, {"version": _VERSION, **info})
    return entry


def _scene(project: ProjectFolder) -> str | None:
    """Return the SHA-256 of the scene that the objects belong to, None where it is not recorded."""
    record = project.recorded_outputs("training").get(SCENE_OUTPUT)
    return None if record is None else str(record["sha256"])


def _move(source: Path, target: Path) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        replace_file(source, target)
    except OSError as error:
        reason = error.strerror or error
        raise DiskError(f"Could not move {source} to {target}: {reason}. Close programs that use it.") from error


def list_trash(project: Path) -> list[Trashed]:
    """Return what the trash of a project folder holds, oldest first. An entry without content is left out."""
    folders = (path.parent.name for path in (project / _TRASH).glob(f"*/{_OBJECT}") if path.is_dir())
    entries = (_read_entry(path_within(project, _TRASH, name)) for name in folders)
    return sorted(entries, key=lambda entry: (entry.deleted, entry.folder.name))


def _read_entry(folder: Path) -> Trashed:
    n_bytes = bytes_of(folder)
    try:
        info = read_json(folder / _INFO, _SCHEMA, advice="Look into its folder.")
        deleted = datetime.fromisoformat(info["deleted"])
        deleted = deleted if deleted.tzinfo else deleted.replace(tzinfo=UTC)
        return Trashed(folder, info["id"], info["name"], deleted, info["why"], info.get("scene"), n_bytes)
    except (FormatError, ValueError):
        # The object is what counts; a damaged note about it must not hide it.
        deleted = datetime.fromtimestamp(folder.stat().st_mtime, UTC)
        return Trashed(folder, folder.name, folder.name, deleted, "its trash.json is damaged", None, n_bytes)


def restore_object(project: ProjectFolder, which: str) -> ObjectRecord:
    """Move an object from the trash back into the project, and return its record.

    `which` is its number in `list_trash`, counted from 1, its name or id, or the name of the entry's folder; the last
    deleted of several is meant. An id or a name that is taken gets a number. Raises `ObjectError` when there is none,
    or it belongs to another training of the scene, and `FormatError` when its record is damaged.
    """
    entry = _find_entry(list_trash(project.path), which)
    stored = entry.folder / _OBJECT / RECORD_FILE
    record, files = read_record(stored), recorded_files(stored)
    present = _scene(project)
    if entry.scene is not None and present is not None and entry.scene != present:
        raise ObjectError(
            f"{entry.name!r} belongs to an earlier training of this scene, so it cannot be restored: isolate it again. "
            f"Its files stay in {entry.folder}."
        )
    name = new_name(record.name, [other.name for other in list_objects(project.path)])
    restored = replace(record, id=new_id(entry.id, taken_ids(project.path)), name=name)
    if name != record.name:
        # In the trash, where a kill leaves an object that can still be restored.
        write_record(stored, restored, files)
    _move(entry.folder / _OBJECT, path_within(project.path, "objects", restored.id))
    delete_derived(project.path, _TRASH, entry.folder.name)
    return restored


def _find_entry(entries: Sequence[Trashed], which: str) -> Trashed:
    if which.isascii() and which.isdigit() and 1 <= int(which) <= len(entries):
        return entries[int(which) - 1]
    for entry in reversed(entries):
        if which in (entry.name, entry.id, entry.folder.name):
            return entry
    known = ", ".join(f"{number} ({entry.name})" for number, entry in enumerate(entries, 1)) or "nothing"
    raise ObjectError(f"The trash has no {which!r}. It holds: {known}.")


def bring_back(project: ProjectFolder, object_id: str, state: str, *, why: str) -> None:
    """Give an object the state that it had before, which the trash has. Its present state, if any, goes to the trash.

    After a kill at any moment the object has the old state or the new one. Its name and museum record stay.

    Parameters
    ----------
    project : ProjectFolder
        Open for writing.
    state : str
        As of `state_of`.
    why : str
        What the list of the trash says of the present state.

    Raises
    ------
    ObjectError
        When the trash has no such state, for example since it was emptied.
    FormatError
        When a record is damaged.
    DiskError
        When a file cannot be written.
    """
    entry = next((one for one in reversed(list_trash(project.path)) if _has_state(one, object_id, state)), None)
    if entry is None:
        raise ObjectError(f"The trash of {project.path} has no earlier state of {object_id!r} any more.")
    folder, stored = path_within(project.path, "objects", object_id), entry.folder / _OBJECT
    if object_id in object_ids(project.path):
        present = read_record(folder / RECORD_FILE)
        if not any(_has_state(one, object_id, state_of(folder)) for one in list_trash(project.path)):
            keep_version(project, object_id, why=why)
        record, files = read_record(stored / RECORD_FILE), recorded_files(stored / RECORD_FILE)
        with replace_together(folder, optional=COMPUTED_FILES) as new:
            for file in stored.iterdir():
                if file.is_file() and not file.is_symlink() and file.name != MUSEUM_RECORD_FILE:
                    shutil.copyfile(file, new / file.name)
            write_record(new / RECORD_FILE, replace(record, id=object_id, name=present.name), files)
    else:
        # What is left of a folder without a record is no object, but may be what the user wrote about it.
        if folder.is_dir() and not any(folder.iterdir()):
            delete_derived(project.path, "objects", object_id)
        _move(stored, folder)
    delete_derived(project.path, _TRASH, entry.folder.name)


def _has_state(entry: Trashed, object_id: str, state: str) -> bool:
    if entry.id != object_id:
        return False
    try:
        return state_of(entry.folder / _OBJECT) == state
    except FormatError:
        return False


def empty_trash(project: ProjectFolder, *, older_than_days: float = 0.0) -> tuple[int, int]:
    """Delete for good what is in the trash for `older_than_days`; return the number of objects and their bytes."""
    latest = datetime.now(UTC) - timedelta(days=older_than_days)
    entries = list_trash(project.path)
    old = [entry for entry in entries if entry.deleted <= latest]
    kept = {entry.folder.name for entry in entries if entry not in old}
    # These are the only files that are deleted without being computed again: the user asked for it. Entries without an
    # object were left by a kill before it was moved there.
    for path in (project.path / _TRASH).glob("*"):
        if path.name not in kept:
            delete_derived(project.path, _TRASH, path.name)
    return len(old), sum(entry.n_bytes for entry in old)
