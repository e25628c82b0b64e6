"""What the project of each scene had of its objects when this Blender looked last, so that panels read no files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..engine.errors import HeritageError
from ..engine.files import object_file
from ..engine.project_content import is_project
from ..engine.records import RECORD_FILE, UNREADABLE, MuseumRecord, load_record, object_states, read_record
from .properties import HeritageObject, HeritageScene, project_of

__all__ = ["StoredObject", "forget", "look", "seen"]


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


def look(project: Path) -> dict[str, StoredObject]:
    """Read what a project has of its objects, by id. One that cannot be read is left as it was seen before.

    Raises
    ------
    FormatError
        When the folder of an object is a link that leads out of the project.
    """
    before = _seen.get(project, {})
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


def _read(project: Path, object_id: str, state: str) -> StoredObject:
    record = read_record(object_file(project, object_id, RECORD_FILE))
    museum = load_record(project, object_id)
    return StoredObject(record.name, museum, state, record.threshold, record.level, record.n_gaussians)


def seen(properties: HeritageObject | HeritageScene) -> dict[str, StoredObject]:
    """Return what the project of an object or scene had when this Blender looked last, by id; empty before that."""
    try:
        return _seen.get(project_of(properties), {}) if properties.project else {}
    except HeritageError:
        return {}


def forget() -> None:
    """Forget what was seen."""
    _seen.clear()
