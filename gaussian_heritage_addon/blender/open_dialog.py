"""The dialog that is open: drawn again when what it waits for has arrived. Blender itself draws a dialog once."""

from __future__ import annotations

import bpy

_region: bpy.types.Region | None = None
"""Of the open dialog. Blender frees it with the dialog, after which it must not be used."""


def is_drawn(context: bpy.types.Context) -> None:
    """Remember the dialog that is being drawn, until `forget_dialog`."""
    global _region
    _region = context.region_popup


def forget_dialog() -> None:
    """Forget the dialog: for ``execute`` and ``cancel`` of its operator, and after a file was loaded."""
    global _region
    _region = None


def redraw_dialog() -> None:
    """Draw the open dialog again; nothing happens where there is none."""
    if _region is not None:
        _region.tag_refresh_ui()
        _region.tag_redraw()
