"""Preview images for panels: image files, reloaded when they change, and training curves."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

import bpy
import bpy.utils.previews

from ...engine.core.errors import PhotoError
from ...engine.core.files import stamp_of
from ..blender.guards import on_unregister
from .curve import Point, curve_picture
from .photo_frame import require_small

_MAX_PIXELS = 16_000_000
"""Pixels of a picture that is decoded for a panel. The engine's have fewer; a small file may state any number."""

_previews: bpy.utils.previews.ImagePreviewCollection | None = None
_preview_keys: dict[str, str] = {}
"""Key of the current preview of each file or curve. Keys change with the content, so that changes are redrawn."""


def picture_icon(file: Path) -> int:
    """Return the icon of an image file with its current content; 0 when it is missing or large, or without a window."""
    changed = stamp_of(file)
    if changed is None or not file.is_file():
        return 0
    key = f"{file} {changed}"
    if _is_new(str(file), key):
        with contextlib.suppress(PhotoError):  # A picture that is too large is not shown.
            require_small(file, _MAX_PIXELS)
            _collection().load(key, str(file), "IMAGE")
    preview = _collection().get(key)
    # Blender decodes it when its size is asked for; otherwise a turning circle stands in its place after each change.
    return int(preview.icon_id) if preview is not None and preview.image_size[0] else 0


def curve_icon(subject: str, points: Sequence[Point]) -> int:
    """Return the icon of a training curve; 0 for fewer than two points, and in background mode.

    Parameters
    ----------
    subject : str
        Name of the curve. A new curve replaces the earlier one of the same name.
    points : sequence of (float, float)
        Seconds, and PSNR in dB.
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
        on_unregister(_remove_previews)
    return _previews


def _is_new(subject: str, key: str) -> bool:
    """Return whether the preview `key` must be created, and remove an outdated one of the same `subject`."""
    earlier_key = _preview_keys.get(subject)
    if earlier_key == key:
        return False
    if earlier_key in _collection():
        del _collection()[earlier_key]
    _preview_keys[subject] = key
    return True


def _remove_previews() -> None:
    global _previews
    bpy.utils.previews.remove(_previews)
    _previews = None
    _preview_keys.clear()
