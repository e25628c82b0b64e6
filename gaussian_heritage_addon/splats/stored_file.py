"""The parts of a PLY file that Blender's attributes of splats do not hold: what was not edited leaves as it came.

Blender's attributes are linear sizes, opacities and rotations of unit length. The file's own numbers, and properties
that are not those of a Gaussian, are further attributes; its header is a custom property of the object.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast, get_args

import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.formats import PlyFile, Up
from ...engine.scene import Gaussians, unit_quats
from ..blender.attributes import FOUR_FLOATS, read_attribute, write_attribute

_PREFIX = "ply."
_LOG_SCALE, _OPACITY, _ROTATION = f"{_PREFIX}log_scale", f"{_PREFIX}opacity_logit", f"{_PREFIX}rotation"
_EXTRA = f"{_PREFIX}extra."
_LOST, _LOST_MORE = f"{_PREFIX}position_lost", f"{_PREFIX}position_lost_more"
"""The digits of a double that float32 does not hold, in two numbers of float32."""
_HEADER_KEY = "heritage_ply_header"
_UP_KEY = "heritage_ply_up"
_KINDS = {
    _LOG_SCALE: "FLOAT_VECTOR",
    _OPACITY: "FLOAT",
    _ROTATION: FOUR_FLOATS,
    _LOST: "FLOAT_VECTOR",
    _LOST_MORE: "FLOAT_VECTOR",
}


@dataclass(frozen=True)
class StoredFile:
    """The numbers and properties that an object keeps of the file that it came from.

    Attributes
    ----------
    header : tuple of str
        Lines of the header.
    up : {"z", "-y", "y"}
        Axis of the file that points up.
    extra : dict of str to array of shape [N]
        Properties that are not those of a Gaussian.
    lost : array of shape [N, 3], float64, or None
        What Blender's float32 does not hold of double positions.
    """

    header: tuple[str, ...]
    up: Up
    extra: Mapping[str, NDArray[Any]]
    lost: NDArray[np.float64] | None


def keep_file(obj: bpy.types.Object, file: PlyFile, up: Up) -> None:
    """Store the numbers, the further properties and the header of `file` on its object, whose axis `up` points up."""
    values = file.gaussians
    kept = [(_LOG_SCALE, values.log_scales), (_OPACITY, values.opacity_logits), (_ROTATION, values.quats)]
    if file.lost is not None:
        lost = file.lost.astype(np.float32)
        kept += [(_LOST, lost), (_LOST_MORE, (file.lost - lost).astype(np.float32))]
    for name, array in kept:
        write_attribute(obj.data, name, _KINDS[name], array)
    for name, array in file.extra.items():
        write_attribute(obj.data, _EXTRA + name, "INT" if array.dtype.kind in "iu" else "FLOAT", array)
    obj[_HEADER_KEY], obj[_UP_KEY] = "\n".join(file.header), up


def with_stored_values(
    mesh: bpy.types.Mesh, gaussians: Gaussians, scales: NDArray[np.float32], opacities: NDArray[np.float32]
) -> Gaussians:
    """Return the Gaussians of `mesh` with the numbers of their file where Blender's attributes were not changed.

    `gaussians` were made of the attributes; `scales` [N, 3] and `opacities` [N] are the attributes themselves.
    """
    log_scales, logits, quats = (_read(mesh, name) for name in (_LOG_SCALE, _OPACITY, _ROTATION))
    if log_scales is None or logits is None or quats is None:
        return gaussians
    stored = replace(gaussians, log_scales=log_scales, opacity_logits=logits, quats=quats)
    with np.errstate(over="ignore"):
        same_scale = (stored.scales == scales).all(axis=1, keepdims=True)
        same_opacity = stored.opacities == opacities
    same_rotation = (unit_quats(quats.astype(np.float64)).astype(np.float32) == gaussians.quats).all(
        axis=1, keepdims=True
    )
    return replace(
        gaussians,
        log_scales=np.where(same_scale, log_scales, gaussians.log_scales),
        opacity_logits=np.where(same_opacity, stored.opacity_logits, gaussians.opacity_logits),
        quats=np.where(same_rotation, quats, gaussians.quats),
    )


def _read(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32] | None:
    return read_attribute(mesh, name, _KINDS[name])


def stored_file(obj: bpy.types.Object, mesh: bpy.types.Mesh) -> StoredFile | None:
    """Return what `obj`, with the present state `mesh`, keeps of its file; None where it came from none."""
    header, up = obj.get(_HEADER_KEY), obj.get(_UP_KEY)
    if not isinstance(header, str) or up not in get_args(Up):
        return None
    extra: dict[str, NDArray[Any]] = {}
    for attribute in mesh.attributes:
        name = attribute.name
        values = read_attribute(mesh, name, "INT", "FLOAT") if name.startswith(_EXTRA) else None
        if values is not None:
            extra[name.removeprefix(_EXTRA)] = values
    return StoredFile(tuple(header.split("\n")) if header else (), cast(Up, up), extra, _lost(mesh))


def _lost(mesh: bpy.types.Mesh) -> NDArray[np.float64] | None:
    lost, more = _read(mesh, _LOST), _read(mesh, _LOST_MORE)
    return None if lost is None or more is None else lost.astype(np.float64) + more


def forget_lost_digits(mesh: bpy.types.Mesh, rows: NDArray[np.intp]) -> None:
    """Store that the positions of `rows` have no more digits than Blender's: they are not those of the file."""
    for name in (_LOST, _LOST_MORE):
        values = _read(mesh, name)
        if values is not None:
            values[rows] = 0
            write_attribute(mesh, name, _KINDS[name], values)
