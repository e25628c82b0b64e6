"""Gaussians as the type that Blender has for them since version 5.3: a point cloud.

Blender's own importers make the same, so that what is read here may have come from them and been edited by the user.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.errors import ObjectError
from ...engine.formats import logits_of
from ...engine.scene import Gaussians
from ..blender.attributes import read_attribute, write_attribute

_KINDS = {
    "position": "FLOAT_VECTOR",
    "rotation": "QUATERNION",
    "scale": "FLOAT_VECTOR",
    "radiance:base": "FLOAT4",
}
"""Types of the attributes that all Gaussians have."""
_SH_KIND = "FLOAT_VECTOR"
HARMONICS = (0, 3, 8, 15)
"""Numbers of spherical harmonics beyond the first, for the degrees 0 to 3."""

_TYPE = "GAUSSIAN_SPLAT"


def is_native() -> bool:
    """Return whether this Blender has a type for Gaussians."""
    kind = bpy.types.PointCloud.bl_rna.properties.get("type")
    return kind is not None and kind.type == "ENUM" and _TYPE in kind.enum_items


def copy_as_native(name: str, gaussians: Gaussians, collection: bpy.types.Collection) -> bpy.types.Object:
    """Add `gaussians` to `collection` as an object that Blender itself draws as Gaussians."""
    cloud = new_point_cloud(name, gaussians)
    cloud.type = _TYPE
    obj = bpy.data.objects.new(name, cloud)
    collection.objects.link(obj)
    return obj


def new_point_cloud(name: str, gaussians: Gaussians) -> bpy.types.PointCloud:
    """Return a point cloud with the attributes of Blender's own import of Gaussians; needs Blender 5.2."""
    cloud = bpy.data.pointclouds.new(name)
    cloud.resize(len(gaussians))
    base = np.concatenate([gaussians.sh[:, 0], gaussians.opacities[:, None]], axis=1)
    values = {
        "position": gaussians.means,
        "rotation": gaussians.quats,
        "scale": gaussians.scales,
        "radiance:base": base,
    }
    for k in range(1, gaussians.sh.shape[1]):
        values[f"radiance:sh_{k - 1}"] = gaussians.sh[:, k]
    for attribute_name, numbers in values.items():
        write_attribute(cloud, attribute_name, _KINDS.get(attribute_name, _SH_KIND), numbers)
    return cloud


def has_native_splats(obj: bpy.types.Object | None) -> bool:
    """Return whether `obj` is a point cloud with the attributes of Blender's own Gaussians."""
    if obj is None or obj.type != "POINTCLOUD":
        return False
    return all(name in obj.data.attributes for name in _KINDS)


def number_of_harmonics(data: bpy.types.PointCloud | bpy.types.Mesh, name: str) -> int:
    """Return how many spherical harmonics beyond the first the points of the object `name` have.

    Raises
    ------
    ObjectError
        When some are missing.
    """
    count = 0
    while f"radiance:sh_{count}" in data.attributes:
        count += 1
    if count not in HARMONICS:
        raise ObjectError(f"{name} lacks some of its colours (radiance:sh). Import the object again.")
    return count


def native_gaussians(obj: bpy.types.Object) -> Gaussians:
    """Return the Gaussians of a point cloud in the frame of the object, with what its modifiers change.

    Raises
    ------
    ObjectError
        When an attribute was removed or changed to another type, or some of the spherical harmonics are missing.
    """
    cloud = obj.data
    if obj.modifiers:
        cloud = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    bands = number_of_harmonics(cloud, obj.name)
    base, scale = _read(obj, cloud, "radiance:base"), np.abs(_read(obj, cloud, "scale"))
    rest = [_read(obj, cloud, f"radiance:sh_{k}") for k in range(bands)]
    quats = _read(obj, cloud, "rotation")
    # A rotation that was never set is zero; files of Gaussians cannot say so.
    quats[~quats.any(axis=1)] = (1, 0, 0, 0)
    return Gaussians(
        means=_read(obj, cloud, "position"),
        log_scales=np.log(np.maximum(scale, np.finfo(np.float32).tiny)),
        quats=quats,
        opacity_logits=logits_of(base[:, 3]),
        sh=np.stack([base[:, :3], *rest], axis=1),
    )


def _read(obj: bpy.types.Object, cloud: bpy.types.PointCloud, name: str) -> NDArray[np.float32]:
    values = read_attribute(cloud, name, _KINDS.get(name, _SH_KIND))
    if values is None:
        raise ObjectError(f"The attribute {name} of {obj.name} was removed or changed. Import the object again.")
    return values
