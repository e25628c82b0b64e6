"""Ctrl+Z for measurements: Blender undoes the placement of the scene, this the file of the project that has it.

Each measurement of this session has a mark, which a scene carries as a custom property. Undo brings an earlier mark
back, and the measurement that it stands for is stored again.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from pathlib import Path

import bpy

from ..engine.errors import ObjectError
from ..engine.scene import Measurement, load_measurement, save_measurement
from .guards import add_load_handler, add_undo_handler, remove_handler
from .properties import project_of

__all__ = ["register", "remember", "unregister"]

_MARK_KEY = "heritage_measured"
"""Custom property of a scene: the mark of what was measured last."""
_meanings: dict[tuple[Path, str], Measurement] = {}
"""By project and mark; the mark is empty where nothing was measured in this session."""
_current: dict[tuple[str, Path], str] = {}
"""By name of the scene and project: the mark that it had when this Blender stored a measurement last."""


def remember(scenes: Sequence[bpy.types.Scene], before: Measurement, after: Measurement) -> None:
    """Remember that the measurement `before` of the project that `scenes` show was replaced by `after`."""
    mark = uuid.uuid4().hex
    for scene in scenes:
        project = project_of(scene.heritage)
        _meanings[project, _mark_of(scene)], _meanings[project, mark] = before, after
        scene[_MARK_KEY] = _current[scene.name, project] = mark


def _mark_of(scene: bpy.types.Scene) -> str:
    mark = scene.get(_MARK_KEY, "")
    return mark if isinstance(mark, str) else ""


def _after_undo() -> None:
    """Store the measurement that the scenes are placed by now.

    Raises
    ------
    ObjectError
        When another program has measured since: what it stored is kept.
    """
    for scene in bpy.data.scenes:
        if not scene.heritage.project:
            continue
        project, mark = project_of(scene.heritage), _mark_of(scene)
        known, wanted = _current.get((scene.name, project), mark), _meanings.get((project, mark))
        if mark == known or wanted is None:
            continue
        _current[scene.name, project] = mark
        stored = load_measurement(project)
        if stored == wanted:  # another scene shows the project, too
            continue
        if stored != _meanings[project, known]:
            raise ObjectError(f"{project.name} was measured by another program since. Open the project again.")
        save_measurement(project, wanted)


def _forget() -> None:
    _meanings.clear()
    _current.clear()


def register() -> None:
    """Follow undo, which does not reach behind the loading of a file."""
    add_undo_handler(_after_undo)
    add_load_handler(_forget)


def unregister() -> None:
    """Undo `register`."""
    remove_handler(_after_undo)
    remove_handler(_forget)
    _forget()
