"""Calls what must follow changes in Blender: splats their vertices, the list Blender's selection, paths the file."""

from __future__ import annotations

import bpy

from ..blender.guards import (
    add_change_handler,
    add_import_handler,
    add_load_handler,
    add_save_handlers,
    add_update_handler,
)
from ..splats import display_settings
from ..splats.properties import apply_visibility, follow_eyes
from ..splats.selection import follow_selection
from ..splats.splats import SplatScene
from . import moved_projects


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
    display_settings.apply_displays()


def _after_appending(items: list[tuple[bpy.types.ID, str]]) -> None:
    moved_projects.after_appending(items)
    # What was appended by scripts may enter a scene later; the button *Set Up Render* treats it as these.
    for scene in bpy.data.scenes:
        display_settings.fit_arrived(scene, {id_block for id_block, _ in items})
        apply_visibility(scene)
    display_settings.apply_displays()


def _before_saving(file: str) -> None:
    moved_projects.before_saving(file)
    display_settings.show_without_addon()


def _after_saving(file: str) -> None:
    moved_projects.after_saving(file)
    display_settings.apply_displays()


def register() -> None:
    """Follow changes, loading, saving and appending."""
    add_change_handler(_after_change)
    add_update_handler(_after_update)
    add_load_handler(_after_loading)
    add_import_handler(_after_appending)
    add_save_handlers(_before_saving, _after_saving)
