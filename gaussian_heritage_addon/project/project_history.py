"""Undo and redo in Blender follow into the project: measurements, objects, their names and their records.

Blender's undo changes what a file shows: the mark of a measurement, the state of each object, names, records. Whatever
this session stored before is then stored again, in the form that it had; see `state_history`. Gaussians come from the
trash of the project, where those that another step replaced are. What another program stored since is kept.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import bpy

from ...engine.core.errors import HeritageError, ObjectError, ProjectError, ProjectInUse
from ...engine.project.content import is_project, require_object
from ...engine.project.folder import ProjectFolder
from ...engine.project.objects import MuseumRecord, bring_back, discard_object, load_record, rename_object, save_record
from ...engine.scene import Measurement, load_measurement, save_measurement
from ..blender.guards import (
    add_datablock_handler,
    add_load_handler,
    add_undo_handler,
    on_unregister,
)
from ..splats.properties import HeritageObject, loading, project_of, record_of, set_record_writer
from .object_names import follow_renames, was_renamed
from .object_state import all_objects, known_objects, mark_copies, owners
from .state_history import StateHistory
from .stored_objects import StoredObject, forget, look, look_if_changed

_MARK_KEY = "heritage_measured"
"""Custom property of a scene: the mark of what was measured last."""
_WHY = "undone in Blender"
_history = StateHistory()
_measured: dict[tuple[Path, str], Measurement] = {}
"""Measurements by project and mark; the mark is empty where nothing was measured in this session."""
_n_objects = 0


def remember_measurement(scenes: Sequence[bpy.types.Scene], before: Measurement, after: Measurement) -> None:
    """Remember that the measurement `before` of the project that `scenes` show was replaced by `after`."""
    mark = uuid.uuid4().hex
    for scene in scenes:
        project, former = project_of(scene.heritage), _mark_of(scene)
        _measured[project, former], _measured[project, mark] = before, after
        scene[_MARK_KEY] = mark
        _history.remember((project, scene.name, "measurement"), former, mark)


def remember_objects(project: Path, before: dict[str, str | None], after: Iterable[str]) -> None:
    """Remember that a job of this session has replaced objects of `project`.

    Parameters
    ----------
    before : dict of str to str or None
        State that this file showed of each object, by id; None where it had none.
    after : iterable of str
        Ids of the objects that the job has made, changed or deleted.
    """
    stored = look(project)
    for object_id in after:
        state = stored[object_id].state if object_id in stored else None
        _history.remember((project, object_id, "state"), before.get(object_id), state)
    _agree(project, stored)


def look_again() -> None:
    """Read what the projects of this file have of their objects now, and note where Blender shows the same."""
    mark_copies()
    stored = {project: look_if_changed(project) for project in _projects()}
    # They take the names of other objects in the projects into account.
    follow_renames()
    for project, objects in stored.items():
        _agree(project, objects)


def catch_up() -> None:
    """Store what Blender shows, after undo, redo or a new name, where this session stored something else.

    A project in which a job works is left alone until that has ended.

    Raises
    ------
    ObjectError
        When another program has changed something since, or an earlier state cannot be stored: the project stays.
    """
    mark_copies()
    follow_renames()
    sentences: list[str] = []
    for scene in bpy.data.scenes:
        try:
            sentences += _follow_measurement(scene) if scene.heritage.project else []
        except HeritageError as error:
            sentences.append(str(error))
    for project in _projects():
        try:
            sentences += _follow_objects(project)
        except ProjectInUse:
            continue
        except HeritageError as error:
            sentences.append(str(error))
    if sentences:
        raise ObjectError(" ".join(dict.fromkeys(sentences)))


def _projects() -> set[Path]:
    """Return the projects that the scenes of this file show and that are there."""
    found = set()
    for scene in bpy.data.scenes:
        if scene.library is None and scene.heritage.project:
            try:
                found.add(project_of(scene.heritage))
            except ProjectError:  # no folder can have that path
                continue
    return {project for project in found if is_project(project)}


# ---- measurements


def _mark_of(scene: bpy.types.Scene) -> str:
    mark = scene.get(_MARK_KEY, "")
    return mark if isinstance(mark, str) else ""


def _follow_measurement(scene: bpy.types.Scene) -> list[str]:
    project, mark = project_of(scene.heritage), _mark_of(scene)
    place = (project, scene.name, "measurement")
    if not _history.leads_to(place, mark) or mark == _history.last(place):
        return []
    wanted, last = _measured[project, mark], _measured[project, _history.last(place)]
    stored = load_measurement(project)
    present = mark if stored == wanted else _history.last(place) if stored == last else None
    if _history.follow(place, mark, present, lambda _: save_measurement(project, wanted)):
        return [f"{project.name} was measured by another program since. Open the project again."]
    return []


# ---- objects


def _follow_objects(project: Path) -> list[str]:
    """Store the objects of a project as Blender shows them, and return what is to be said."""
    shown = {object_id: obj for (one, object_id), obj in owners().items() if one == project}
    waiting = [*_waiting_states(project, shown), *_waiting_texts(project, shown)]
    if not waiting:
        return []
    sentences = []
    try:
        with ProjectFolder.open_existing(project) as opened:
            for object_id, kind, wanted in waiting:
                sentences += _follow(opened, object_id, kind, wanted)
    except ProjectInUse:
        raise
    except HeritageError:
        # A disk that cannot be written: said once, and marked in the list.
        for object_id, kind, wanted in waiting:
            _history.refuse((project, object_id, kind), wanted)
        raise
    finally:
        _agree(project, look(project))
    return sentences


def _waiting_states(project: Path, shown: dict[str, bpy.types.Object]) -> list[tuple[str, str, Any]]:
    known = known_objects(project)
    waiting: list[tuple[str, str, Any]] = []
    for object_id in _history.names_of(project, "state"):
        obj, place = shown.get(object_id), (project, object_id, "state")
        # What was edited or deleted by hand is stored on request only, as is what a script made, which has no state.
        if object_id in known if obj is None else obj.heritage.is_edited or not obj.heritage_state.state:
            continue
        wanted = None if obj is None else obj.heritage_state.state
        if _history.waits(place, wanted):
            waiting.append((object_id, "state", wanted))
    return waiting


def _waiting_texts(project: Path, shown: dict[str, bpy.types.Object]) -> list[tuple[str, str, Any]]:
    waiting: list[tuple[str, str, Any]] = []
    for object_id, obj in shown.items():
        for kind, wanted in (("name", obj.heritage_state.object_name), ("record", record_of(obj))):
            if _history.waits((project, object_id, kind), wanted, always=True):
                waiting.append((object_id, kind, wanted))
    return waiting


def _follow(opened: ProjectFolder, object_id: str, kind: str, wanted: Any) -> list[str]:
    """Store one value, and return what is to be said of it."""
    project, place = opened.path, (opened.path, object_id, kind)
    stored = look(project).get(object_id)
    try:
        present = None if stored is None else getattr(stored, kind)
        is_kept = _history.follow(place, wanted, present, _storing(opened, object_id, kind), always=kind != "state")
    except ObjectError as error:
        _history.refuse(place, wanted)
        return [f"{error} Store Edits writes what Blender shows."]
    if not is_kept:
        return []
    name = stored.name if stored is not None else object_id
    return [
        f"{name} of {project.name} was changed by another program since, and stays so there. Store Edits replaces it, "
        "Open Project shows it."
    ]


def _storing(opened: ProjectFolder, object_id: str, kind: str) -> Callable[[Any], None]:
    def store_state(state: str | None) -> None:
        if state is None:
            discard_object(opened, object_id, why=_WHY)
        else:
            bring_back(opened, object_id, state, why=_WHY)

    def store_name(name: str) -> None:
        require_object(opened.path, object_id)
        rename_object(opened.path, object_id, name)

    def store_record(record: MuseumRecord) -> None:
        require_object(opened.path, object_id)
        save_record(opened.path, object_id, record)

    writers: dict[str, Callable[[Any], None]] = {"state": store_state, "name": store_name, "record": store_record}
    return writers[kind]


def _agree(project: Path, stored: dict[str, StoredObject]) -> None:
    """Note what a project has as Blender shows it: later names and records follow from these."""
    for (one, object_id), obj in owners().items():
        known = stored.get(object_id) if one == project else None
        if known is None:
            continue
        state = obj.heritage_state
        if state.object_name == known.name:
            _history.agree((project, object_id, "name"), known.name)
            if state.stored_name != known.name:
                state.stored_name = known.name
        if record_of(obj) == known.record:
            _history.agree((project, object_id, "record"), known.record)


def _write_record(obj: bpy.types.Object) -> None:
    """Store the record of an object, of which the user has just changed a field.

    Fields that another program has changed since are taken from there.

    Raises
    ------
    HeritageError
        When the project has no such object, it cannot be written, or `obj` is a copy.
    """
    properties: HeritageObject = obj.heritage
    if obj.heritage_state.is_copy:
        raise ObjectError(f"{obj.name} is a copy. Changes are kept in this .blend file only.")
    # A .blend file from someone else may name any folder. Only a project that has this object is written to.
    project = project_of(properties)
    require_object(project, properties.object_id)
    place = (project, properties.object_id, "record")
    mine, theirs = asdict(record_of(obj)), asdict(load_record(project, properties.object_id))
    base = asdict(_history.last(place, record_of(obj)))
    known = _history.last(place) is not None
    merged = {name: theirs[name] if known and mine[name] == base[name] else mine[name] for name in mine}
    record = MuseumRecord(**merged)
    save_record(project, properties.object_id, record)
    _history.agree(place, record)
    if merged != mine:
        with loading(properties):
            for name, value in merged.items():
                setattr(properties, name, value)


# ---- handlers


def _after_change(changed: list[bpy.types.ID]) -> None:
    """Follow new names, and copies, at once."""
    global _n_objects
    count = len(bpy.data.objects)
    # What is hidden is not evaluated, so its change is reported without its name.
    if count == _n_objects and not any(was_renamed(one) for one in changed or all_objects()):
        return
    _n_objects = count
    catch_up()


def _after_loading() -> None:
    """Begin anew: undo does not reach behind the loading of a file."""
    _clear()
    look_again()


def _clear() -> None:
    _history.clear()
    _measured.clear()
    forget()


def register() -> None:
    """Follow undo, redo, names and records."""
    set_record_writer(_write_record)
    on_unregister(set_record_writer, None)
    on_unregister(_clear)
    add_undo_handler(catch_up)
    add_load_handler(_after_loading)
    add_datablock_handler(_after_change)
