"""The objects of the project of each scene when this Blender looked last, so that panels read no files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...engine.core.errors import HeritageError
from ...engine.core.files import object_file, stamp_of
from ...engine.project.content import is_project
from ...engine.project.objects import (
    MEMBERSHIP_FILE,
    MUSEUM_RECORD_FILE,
    RECORD_FILE,
    UNREADABLE,
    MuseumRecord,
    load_record,
    object_ids,
    object_states,
    read_record,
)
from ..splats.properties import HeritageObject, HeritageScene, project_of

_Stamps = tuple[tuple[str, str, tuple[int, int] | None], ...]


@dataclass(frozen=True)
class StoredObject:
    """An object of a project: its name, museum record, state (`state_of`), threshold, level and Gaussians at these."""

    name: str
    record: MuseumRecord
    state: str
    threshold: float
    level: int
    n_gaussians: int


_seen: dict[Path, dict[str, StoredObject]] = {}
_stamps: dict[Path, _Stamps] = {}


def look(project: Path) -> dict[str, StoredObject]:
    """Read what a project has of its objects, by id. One that cannot be read is left as it was seen before.

    Raises
    ------
    FormatError
        When the folder of an object is a link that leads out of the project.
    """
    before = _seen.get(project, {})
    _stamps[project] = _stamps_of(project)
    _seen[project] = found = {}
    for object_id, state in (object_states(project) if is_project(project) else {}).items():
        try:
            stored = None if state == UNREADABLE else _read(project, object_id, state)
        except HeritageError:
            stored = None
        stored = stored or before.get(object_id)
        if stored is not None:
            found[object_id] = stored
    return found


def look_if_changed(project: Path) -> dict[str, StoredObject]:
    """Return the same as `look`, without reading anything where no file was replaced since; raises the same."""
    if _stamps.get(project) == _stamps_of(project):
        return _seen[project]
    return look(project)


def _stamps_of(project: Path) -> _Stamps:
    """Return time and size of the files that describe the objects of a project."""
    found = []
    for object_id in object_ids(project):
        for name in (RECORD_FILE, MUSEUM_RECORD_FILE, MEMBERSHIP_FILE):
            found.append((object_id, name, stamp_of(object_file(project, object_id, name))))
    return tuple(found)


def _read(project: Path, object_id: str, state: str) -> StoredObject:
    record = read_record(object_file(project, object_id, RECORD_FILE))
    museum = load_record(project, object_id)
    return StoredObject(record.name, museum, state, record.threshold, record.level, record.n_gaussians)


def seen(properties: HeritageObject | HeritageScene) -> dict[str, StoredObject] | None:
    """Return what the project of an object or scene had when this Blender looked last, by id; None before that."""
    try:
        return _seen.get(project_of(properties)) if properties.project else None
    except HeritageError:
        return None


def forget() -> None:
    """Forget what was seen."""
    _seen.clear()
    _stamps.clear()
