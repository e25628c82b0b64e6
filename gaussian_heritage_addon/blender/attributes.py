"""Attributes of the vertices of a mesh, or of the points of a point cloud, as arrays."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

# FLOAT4 exists since Blender 5.2. Before, FLOAT_COLOR stores the same four floats, including negative ones.
FOUR_FLOATS = "FLOAT4" if bpy.app.version >= (5, 2, 0) else "FLOAT_COLOR"
VECTORS = {
    "FLOAT_VECTOR": ("vector", 3),
    "QUATERNION": ("value", 4),
    "FLOAT4": ("vector", 4),
    "FLOAT_COLOR": ("color", 4),
}
"""By type: Blender's name of the values of a point, and how many they are."""


def read_attribute(data: bpy.types.Mesh | bpy.types.PointCloud, name: str, *kinds: str) -> NDArray[Any] | None:
    """Return the values, [N] or [N, K], of an attribute of one of the types `kinds`; None where there is none."""
    attribute = data.attributes.get(name)
    if attribute is None or attribute.data_type not in kinds or attribute.domain != "POINT":
        return None
    element, width = VECTORS.get(attribute.data_type, ("value", 1))
    values = np.zeros(len(attribute.data) * width, np.int32 if attribute.data_type == "INT" else np.float32)
    attribute.data.foreach_get(element, values)
    return values.reshape(-1, width) if width > 1 else values


def write_attribute(data: bpy.types.Mesh | bpy.types.PointCloud, name: str, kind: str, values: NDArray[Any]) -> None:
    """Set the values, [N] or [N, K], of an attribute of the type `kind`, which replaces one of another type."""
    attribute = data.attributes.get(name)
    if attribute is not None and (attribute.data_type, attribute.domain) != (kind, "POINT"):
        data.attributes.remove(attribute)
        attribute = None
    attribute = attribute or data.attributes.new(name, kind, "POINT")
    element, _ = VECTORS.get(kind, ("value", 1))
    attribute.data.foreach_set(element, np.ascontiguousarray(values, np.int32 if kind == "INT" else np.float32).ravel())
