"""Projects that this Blender has open. A second Blender of the same user on one project learns of the first.

The marks are in the user's own folder: opening a .blend file of someone else writes nothing to the folders it names.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import IO

import bpy

from ...engine.core.errors import HeritageError
from ...engine.project.content import is_project
from ...engine.project.folder import hold_mark
from ..blender import problems
from ..blender.guards import Timer, on_unregister
from ..setup.preferences import user_folder
from ..splats.properties import project_of
from .project_history import catch_up, look_again

_CHECK_SECONDS = 5.0
"""Seconds between two looks at which projects are shown, what they hold, and whether the other Blender was closed."""

_claims: dict[Path, IO[str]] = {}
_elsewhere: set[Path] = set()


def is_open_elsewhere(project: Path) -> bool:
    """Return whether another Blender had `project` open when this one looked last."""
    return project in _elsewhere


def mark_of(project: Path) -> Path:
    """Return the file that marks `project` as open."""
    return user_folder("open projects") / f"{hashlib.sha256(str(project.resolve()).encode()).hexdigest()[:32]}.lock"


def update() -> None:
    """Claim the projects that the scenes of this file show, and release all others."""
    shown = {project_of(scene.heritage) for scene in bpy.data.scenes if scene.heritage.project}
    for project in [one for one in _claims if one not in shown]:
        _claims.pop(project).close()
    _elsewhere.intersection_update(shown)
    for project in shown - set(_claims):
        if not is_project(project):
            continue
        try:
            claim = hold_mark(mark_of(project))
        except HeritageError:
            # Neither learns of the other then; everything else works.
            continue
        if claim is None:
            _elsewhere.add(project)
        else:
            _claims[project] = claim
            _elsewhere.discard(project)


def _check() -> float:
    update()
    try:
        look_again()
        catch_up()
    except HeritageError as error:
        # The next look may find it mended.
        problems.show(problems.sentence_of(error))
    return _CHECK_SECONDS


_timer = Timer(_check)


def register() -> None:
    """Begin to look. Not when a file is loaded: that alone writes nothing."""
    on_unregister(_release)
    if not bpy.app.background:
        _timer.start(_CHECK_SECONDS, persistent=True)


def _release() -> None:
    while _claims:
        _claims.popitem()[1].close()
    _elsewhere.clear()
