"""Calls what must follow changes in Blender: splats their vertices, the list Blender's selection, paths the file."""

from __future__ import annotations

import bpy

from . import moved_projects
from .guards import (
    add_change_handler,
    add_import_handler,
    add_load_handler,
    add_save_handlers,
    add_update_handler,
    remove_change_handler,
    remove_handler,
    remove_save_handlers,
)
from .properties import follow_eyes, follow_selection
from .splats import SplatScene

__all__ = ["register", "unregister"]


def _after_change(changed: list[bpy.types.ID]) -> None:
    for obj in [one for one in changed if isinstance(one, bpy.types.Object)]:
        if SplatScene.is_splats(obj):
            SplatScene.of(obj).follow_vertices()


def _after_update() -> None:
    for scene in bpy.data.scenes:
        follow_eyes(scene)
        follow_selection(scene)


def _after_loading() -> None:
    for obj in bpy.data.objects:
        if SplatScene.is_splats(obj):
            SplatScene.of(obj).follow_vertices()
    _after_update()
    moved_projects.find_moved()


def register() -> None:
    """Follow changes, loading, saving and appending."""
    add_change_handler(_after_change)
    add_update_handler(_after_update)
    add_load_handler(_after_loading)
    add_import_handler(moved_projects.after_appending)
    add_save_handlers(moved_projects.before_saving, moved_projects.after_saving)


def unregister() -> None:
    """Undo `register`."""
    remove_save_handlers()
    remove_handler(moved_projects.after_appending)
    remove_handler(_after_loading)
    remove_handler(_after_update)
    remove_change_handler(_after_change)
