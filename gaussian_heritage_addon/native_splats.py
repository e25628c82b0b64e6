"""Gaussians as the type that Blender has for them since version 5.3: a point cloud.

Written after Blender's documentation and not run in Blender 5.3, which was not at hand. Only the attributes are tested,
in Blender 5.2, which has them already.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..engine.scene import Gaussians

__all__ = ["copy_as_native", "is_native", "new_point_cloud"]

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
        "position": ("FLOAT_VECTOR", "vector", gaussians.means),
        "rotation": ("QUATERNION", "value", gaussians.quats),
        "scale": ("FLOAT_VECTOR", "vector", gaussians.scales),
        "radiance:base": ("FLOAT4", "vector", base),
    }
    for k in range(1, gaussians.sh.shape[1]):
        values[f"radiance:sh_{k - 1}"] = ("FLOAT_VECTOR", "vector", gaussians.sh[:, k])
    for attribute_name, (data_type, key, numbers) in values.items():
        attribute = cloud.attributes.get(attribute_name) or cloud.attributes.new(attribute_name, data_type, "POINT")
        attribute.data.foreach_set(key, np.ascontiguousarray(numbers, np.float32).ravel())
    return cloud
