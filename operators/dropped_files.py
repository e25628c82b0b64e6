"""Where files may be dropped."""

from __future__ import annotations

import bpy
from bpy_extras.io_utils import poll_file_object_drop


class DroppedIntoView:
    """Base of file handlers for files that are dropped into the 3D viewport or the outliner."""

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Return whether files can be dropped here."""
        return poll_file_object_drop(context)
