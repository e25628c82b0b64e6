"""Keyboard shortcuts in the 3D view. They are listed, and can be changed, in Blender's preferences under Keymap."""

from __future__ import annotations

from typing import Any

import bpy

__all__ = ["SHORTCUTS", "register", "unregister"]

SHORTCUTS: tuple[tuple[str, str, dict[str, str]], ...] = (
    ("S", "heritage.pick_object", {"action": "SELECT"}),
    ("I", "heritage.pick_object", {"action": "ISOLATE"}),
    ("A", "heritage.edit_region", {"action": "ADD", "shape": "LASSO"}),
    ("T", "heritage.edit_region", {"action": "TAKE", "shape": "LASSO"}),
    ("R", "heritage.measure", {"action": "RULER"}),
)
"""Key, pressed together with Ctrl, Shift and Alt; operator; and its options."""

_items: list[tuple[Any, Any]] = []


def register() -> None:
    """Add the shortcuts; nothing happens without a window."""
    keyconfig = bpy.context.window_manager.keyconfigs.addon
    if keyconfig is None:
        return
    keymap = keyconfig.keymaps.new(name="3D View", space_type="VIEW_3D")
    for key, operator, options in SHORTCUTS:
        item = keymap.keymap_items.new(operator, key, "PRESS", ctrl=True, shift=True, alt=True)
        for name, value in options.items():
            setattr(item.properties, name, value)
        _items.append((keymap, item))


def unregister() -> None:
    """Remove them."""
    while _items:
        keymap, item = _items.pop()
        keymap.keymap_items.remove(item)
