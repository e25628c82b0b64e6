"""Keys of the 3D view. They are listed, and can be changed, in Blender's preferences under Keymap.

Wherever the user's keymap selects objects by a click, a box or a lasso, splats are selected by the same event.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..gaussian_heritage_addon.blender.guards import Timer, add_load_handler, on_unregister

SHORTCUTS: tuple[tuple[str, str, dict[str, str]], ...] = (
    ("S", "heritage.pick_object", {"action": "SELECT"}),
    ("I", "heritage.pick_object", {"action": "ISOLATE"}),
    ("A", "heritage.edit_region", {"action": "ADD", "shape": "LASSO"}),
    ("T", "heritage.edit_region", {"action": "TAKE", "shape": "LASSO"}),
    ("R", "heritage.measure", {"action": "RULER"}),
)
"""Key, pressed together with Ctrl, Shift and Alt; operator; and its options."""

_SELECTING: dict[str, tuple[str, dict[str, str]]] = {
    "view3d.select": ("heritage.select_splats", {}),
    "view3d.select_box": ("heritage.select_splats_within", {"shape": "BOX"}),
    "view3d.select_lasso": ("heritage.select_splats_within", {"shape": "LASSO"}),
}
"""For each operator of Blender that selects objects: ours for splats, and its options."""
_SAME_OPTIONS = ("extend", "deselect", "toggle", "mode")
_OTHER_MEANINGS = ("center", "enumerate", "object")
"""Options of Blender's click with which it asks, or selects by centres."""
_TOOLS = "3D View Tool: "
"""Begin of the names of the keymaps of tools."""
_READY = 1.0
"""Seconds after which Blender has read the user's keymap."""

_items: list[tuple[Any, Any]] = []
_selecting: list[tuple[Any, Any]] = []


def _follow_keymap() -> None:
    """Give the operators for splats the events of Blender's own. Items of add-ons come first in a keymap."""
    keyconfigs = bpy.context.window_manager.keyconfigs
    _remove(_selecting)
    # All are read before one is added: to add one renews the user's keymap.
    wanted = [
        (keymap.name, keymap.space_type, keymap.region_type, _event_of(item), *_ours(item))
        for keymap in keyconfigs.user.keymaps
        if keymap.space_type == "VIEW_3D" and not keymap.is_modal
        for item in keymap.keymap_items
        if item.idname in _SELECTING
        and item.active
        and not any(getattr(item.properties, name, False) for name in _OTHER_MEANINGS)
    ]
    for name, space, region, event, operator, options in wanted:
        keymap = keyconfigs.addon.keymaps.new(name, space_type=space, region_type=region, tool=name.startswith(_TOOLS))
        new = keymap.keymap_items.new(operator, **event)
        for option, value in options.items():
            setattr(new.properties, option, value)
        _selecting.append((keymap, new))


def _event_of(item: Any) -> dict[str, Any]:
    names = ("type", "value", "any", "shift", "ctrl", "alt", "oskey", "key_modifier", "direction")
    return {name: getattr(item, name) for name in names}


def _ours(item: Any) -> tuple[str, dict[str, Any]]:
    """Return our operator for an item of the user's keymap, and its options."""
    operator, options = _SELECTING[item.idname]
    given: dict[str, Any] = {
        name: getattr(item.properties, name)
        for name in _SAME_OPTIONS
        if name in item.properties.bl_rna.properties and item.properties.is_property_set(name)
    }
    return operator, given | options


_keymap_timer = Timer(_follow_keymap)


def _follow_keymap_soon() -> None:
    _keymap_timer.start(_READY)


def _remove(items: list[tuple[Any, Any]]) -> None:
    while items:
        keymap, item = items.pop()
        keymap.keymap_items.remove(item)


def register() -> None:
    """Add the shortcuts; nothing happens without a window."""
    keyconfig = bpy.context.window_manager.keyconfigs.addon
    if keyconfig is None:
        return
    on_unregister(_remove, _items)
    on_unregister(_remove, _selecting)
    keymap = keyconfig.keymaps.new(name="3D View", space_type="VIEW_3D")
    for key, operator, options in SHORTCUTS:
        item = keymap.keymap_items.new(operator, key, "PRESS", ctrl=True, shift=True, alt=True)
        for name, value in options.items():
            setattr(item.properties, name, value)
        _items.append((keymap, item))
    _follow_keymap_soon()
    # The user may have chosen another keymap meanwhile.
    add_load_handler(_follow_keymap_soon)
