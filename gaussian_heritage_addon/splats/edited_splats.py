"""Splats in Edit Mode as viewports draw them. They are read while nothing is drawn: reading makes a copy."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import bmesh
import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float32
from ..blender.guards import Timer, add_change_handler, add_load_handler, on_unregister
from .selection import heritage_objects
from .solid_mode import redraw_viewports
from .splats import SplatScene

_PAUSE = 0.4
"""Seconds without a change after which vertices that are being moved are read."""


@dataclass(frozen=True)
class EditedSplats:
    """The Gaussians of an object in Edit Mode. It takes the place of a `SplatScene` where they are drawn.

    Attributes
    ----------
    attributes : dict
        By name: values of shape [N, 3] or [N, 4].
    membership : array of shape [N], or None for a whole scene
    sh_degree : int
    version : int
        Grows with each reading.
    """

    attributes: dict[str, Float32]
    membership: Float32 | None
    sh_degree: int
    version: int

    def attribute(self, name: str) -> Float32:
        """Return the values of an attribute; see `SplatScene.attribute`."""
        return self.attributes[name]


_read: dict[str, EditedSplats] = {}
"""By name of the mesh."""
_changed_at: dict[str, float] = {}
"""By name of the mesh: when its vertices changed after they were read, by ``time.monotonic``."""


def is_editing_splats(obj: bpy.types.Object) -> bool:
    """Return whether `obj` is in Edit Mode, in which its attributes cannot be read while something is drawn."""
    return bool(obj.mode == "EDIT")


def edited_splats(obj: bpy.types.Object) -> EditedSplats | None:
    """Return the Gaussians of an object in Edit Mode; None until they are read, after which viewports draw again."""
    found = _read.get(obj.data.name_full)
    if found is None:
        _timer.start(0.0)
    return found


def vertex_flags(obj: bpy.types.Object) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which vertices of an object in Edit Mode are selected, and which are hidden, shape [N] each."""
    vertices = bmesh.from_edit_mesh(obj.data).verts
    count = len(vertices)
    selected = np.fromiter((vertex.select for vertex in vertices), bool, count)
    return selected, np.fromiter((vertex.hide for vertex in vertices), bool, count)


def _edited() -> Iterator[bpy.types.Object]:
    for scene in bpy.data.scenes:
        yield from (obj for obj in heritage_objects(scene) if is_editing_splats(obj) and SplatScene.is_splats(obj))


def _after_change(changed: list[bpy.types.ID]) -> None:
    edited = {obj.data.name_full for obj in _edited()}
    for name in _read.keys() - edited:
        # Outside of Edit Mode the mesh itself can be read.
        del _read[name]
    names = {data.name_full for data in changed if isinstance(data, bpy.types.Mesh)} & edited
    _changed_at.update(dict.fromkeys(names, time.monotonic()))
    if names:
        _timer.start(0.0 if names - _read.keys() else _PAUSE)


def _hide_what_is_not_shown(obj: bpy.types.Object, membership: Float32 | None) -> None:
    """Hide the vertices below the threshold, as H does: as bare dots they would look like parts of the object."""
    if membership is None:
        return
    mesh = bmesh.from_edit_mesh(obj.data)
    shown = membership >= np.float32(obj.heritage.threshold)
    for vertex, is_shown in zip(mesh.verts, shown.tolist(), strict=True):
        if vertex.hide == is_shown:
            vertex.hide_set(not is_shown)
    bmesh.update_edit_mesh(obj.data, loop_triangles=False, destructive=False)


def _read_changed() -> float | None:
    now = time.monotonic()
    waiting = False
    for obj in _edited():
        name = obj.data.name_full
        former, changed_at = _read.get(name), _changed_at.get(name)
        if former is not None and changed_at is None:
            continue
        if former is not None and changed_at is not None and now - changed_at < _PAUSE:
            waiting = True
            continue
        splats = SplatScene.of(obj)
        if former is None:
            _hide_what_is_not_shown(obj, splats.membership)
        _read[name] = EditedSplats(
            splats.attributes(), splats.membership, splats.sh_degree, 0 if former is None else former.version + 1
        )
        _changed_at.pop(name, None)
        redraw_viewports()
    return _PAUSE if waiting else None


_timer = Timer(_read_changed)


def _forget() -> None:
    _read.clear()
    _changed_at.clear()


def register() -> None:
    """Follow changes in Edit Mode."""
    add_change_handler(_after_change)
    add_load_handler(_forget)
    on_unregister(_forget)
