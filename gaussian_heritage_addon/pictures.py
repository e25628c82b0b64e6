"""Small pictures for panels: files as they are now, and the curve of a training."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
import bpy.utils.previews

from .curve import Point, curve_picture

__all__ = ["curve_icon", "picture_icon", "unregister"]

_previews: bpy.utils.previews.ImagePreviewCollection | None = None
_shown: dict[str, str] = {}
"""Which preview stands for a file or curve: previews are told apart by content, so that a new one is drawn anew."""


def picture_icon(file: Path) -> int:
    """Return the icon of a picture file as it is now; 0 when it is not there, and in background mode."""
    try:
        changed = file.stat().st_mtime_ns
    except OSError:
        return 0
    key = f"{file} {changed}"
    if _is_new(str(file), key):
        _collection().load(key, str(file), "IMAGE")
    return int(_collection()[key].icon_id)


def curve_icon(subject: str, points: Sequence[Point]) -> int:
    """Return the icon of error against run time; 0 when there is too little to draw, and in background mode.

    Parameters
    ----------
    subject : str
        Whose curve: its earlier picture is let go.
    points : sequence of (float, float)
        Seconds and PSNR.
    """
    key = f"curve of {subject} {hash(tuple(points))}"
    if _is_new(f"curve of {subject}", key):
        picture = curve_picture(points)
        preview = _collection().new(key)
        if picture is not None:
            preview.image_size = picture.shape[1], picture.shape[0]
            preview.image_pixels_float.foreach_set(picture.ravel())
    preview = _collection()[key]
    return int(preview.icon_id) if preview.image_size[0] else 0


def _collection() -> bpy.utils.previews.ImagePreviewCollection:
    global _previews
    if _previews is None:
        _previews = bpy.utils.previews.new()
    return _previews


def _is_new(subject: str, key: str) -> bool:
    """Return whether there is no preview `key` yet; the one that stood for `subject` before goes."""
    before = _shown.get(subject)
    if before == key:
        return False
    if before is not None:
        del _collection()[before]
    _shown[subject] = key
    return True


def unregister() -> None:
    """Let all pictures go."""
    global _previews
    if _previews is not None:
        bpy.utils.previews.remove(_previews)
    _previews = None
    _shown.clear()
