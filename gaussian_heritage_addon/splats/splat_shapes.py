"""Geometry nodes that create a shape for each Gaussian: ellipsoids in the viewport, flat cards in renders.

Ellipsoids are correct from every direction. Cards face the active camera and reproduce the engine's projection
(Zwicker et al. 2001, as in Kerbl et al. 2023): each is the ellipse of the linearised projection, in the plane of the
Gaussian's centre parallel to the image, so that cards too are sorted by the depth of the centres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy

from ...engine.rasterizer.settings import ALPHA_MIN, RasterSettings
from ..blender.node_math import Formula, connect, named_attribute, new_node, vector
from .splat_material import COLOR_ATTRIBUTE, splat_material

_ICOSAHEDRON_RADIUS = 1.2584086
"""Radius of the corners of an icosahedron whose faces touch the unit sphere, so that it contains the ellipsoid."""
_OCTAHEDRON_SEGMENTS, _OCTAHEDRON_RINGS = 4, 2
_SOLID_RADIUS = 1.5
"""Distance of the corners of an opaque shape from its centre, in standard deviations."""
_RASTER = RasterSettings()
"""The engine's settings, for the low-pass filter and the near plane."""


@dataclass(frozen=True)
class Cutoff:
    """The Gaussians to draw, and where each is cut off.

    Attributes
    ----------
    points : socket
        Points with the attributes described in `splats`.
    drawn : Formula
        1 for Gaussians that are drawn, else 0.
    radius : Formula
        Radius in standard deviations at which the density falls to 1/255.
    """

    points: Any
    drawn: Formula
    radius: Formula


@dataclass(frozen=True)
class Projection:
    """The inputs of the cards besides the pose of the camera.

    Attributes
    ----------
    pixel : Formula
        Size of a pixel at distance 1, for the engine's low-pass filter; 0 turns it off.
    low, high : sequence of Formula
        Bounds of X/Z and Y/Z, between which the projection is linearised.
    antialiased : Formula
        1 where the low-pass filter reduces the opacity by as much as it widens a Gaussian, else 0.
    opacity : Formula
    """

    pixel: Formula
    low: Sequence[Formula]
    high: Sequence[Formula]
    antialiased: Formula
    opacity: Formula


def radius_of(opacity: Formula) -> Formula:
    """Return the radius in standard deviations at which the density of a Gaussian falls to 1/255."""
    return ((opacity * (1.0 / ALPHA_MIN)).maximum(1.0).log() * 2.0).sqrt()


def add_ellipsoids(tree: bpy.types.NodeTree, cutoff: Cutoff) -> Any:
    """Return instances of an icosahedron, scaled to contain the cut-off of each Gaussian."""
    shape = new_node(tree, "GeometryNodeMeshIcoSphere", Radius=_ICOSAHEDRON_RADIUS, Subdivisions=1)
    shape_with_material = _with_material(tree, shape.outputs["Mesh"], flat=False)
    instances = new_node(
        tree,
        "GeometryNodeInstanceOnPoints",
        Points=cutoff.points,
        Selection=cutoff.drawn,
        Instance=shape_with_material,
        Rotation=named_attribute(tree, "rotation", "QUATERNION"),
        Scale=vector(tree, "SCALE", named_attribute(tree, "scale", "FLOAT_VECTOR"), cutoff.radius),
    )
    return instances.outputs["Instances"]


def add_solids(tree: bpy.types.NodeTree, cutoff: Cutoff, mesh: Any) -> Any:
    """Return one mesh with an opaque octahedron for each Gaussian, for the viewport modes Solid and Wireframe.

    Those modes draw no transparency, and the colours of a mesh but not those of instances. `mesh` is the mesh of the
    Gaussians: the result takes over which of its attributes is its colour.
    """
    shape = new_node(
        tree, "GeometryNodeMeshUVSphere", Radius=_SOLID_RADIUS, Segments=_OCTAHEDRON_SEGMENTS, Rings=_OCTAHEDRON_RINGS
    )
    instances = new_node(
        tree,
        "GeometryNodeInstanceOnPoints",
        Points=cutoff.points,
        Selection=cutoff.drawn,
        Instance=shape.outputs["Mesh"],
        Rotation=named_attribute(tree, "rotation", "QUATERNION"),
        Scale=named_attribute(tree, "scale", "FLOAT_VECTOR"),
    )
    others = new_node(
        tree,
        "FunctionNodeCompare",
        {"data_type": "INT", "operation": "GREATER_THAN"},
        A=tree.nodes.new("GeometryNodeInputIndex").outputs[0],
        B=0,
    )
    one_vertex = new_node(tree, "GeometryNodeDeleteGeometry", Geometry=mesh, Selection=others.outputs[0])
    joined = tree.nodes.new("GeometryNodeJoinGeometry")
    tree.links.new(instances.outputs["Instances"], joined.inputs[0])
    tree.links.new(one_vertex.outputs[0], joined.inputs[0])
    return new_node(tree, "GeometryNodeRealizeInstances", Geometry=joined.outputs[0]).outputs["Geometry"]


def add_cards(tree: bpy.types.NodeTree, cutoff: Cutoff, projection: Projection) -> Any:
    """Return instances of a square, transformed to contain the ellipse of each Gaussian seen by the active camera.

    Notes
    -----
    Let A = R S be the axes of the ellipsoid in camera coordinates and (X, Y, Z) its centre. The ellipse at depth Z has
    the covariance ``T A (T A)^T`` with ``T = [[1, 0, -X/Z], [0, 1, -Y/Z]]``. The columns of its Cholesky factor span
    the card. X/Z and Y/Z in T are clamped to the bounds of the projection: they grow without limit for Gaussians
    beside the camera, whose cards would cover the picture.
    """
    right, up, forward, camera_position = _camera_axes(tree)
    center = tree.nodes.new("GeometryNodeInputPosition").outputs[0]
    offset = vector(tree, "SUBTRACT", center, camera_position)

    def dot(axis: Any, other: Any) -> Formula:
        return Formula(tree, vector(tree, "DOT_PRODUCT", axis, other, output="Value"))

    depth = dot(forward, offset)
    slope_x = (dot(right, offset) / depth).maximum(projection.low[0]).minimum(projection.high[0])
    slope_y = (dot(up, offset) / depth).maximum(projection.low[1]).minimum(projection.high[1])
    low_pass = projection.pixel * projection.pixel * depth * depth * _RASTER.low_pass
    xx, xy, yy = low_pass, Formula(tree, 0.0), low_pass
    projected = []
    for axis in _ellipsoid_axes(tree):
        axis_depth = dot(forward, axis)
        x, y = dot(right, axis) - slope_x * axis_depth, dot(up, axis) - slope_y * axis_depth
        xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        projected.append((x, y))
    # The determinant without the low pass is a sum of squares (Cauchy-Binet), which loses no digits.
    (x0, y0), (x1, y1), (x2, y2) = projected
    minors = (x0 * y1 - x1 * y0, x1 * y2 - x2 * y1, x2 * y0 - x0 * y2)
    alone = minors[0] * minors[0] + minors[1] * minors[1] + minors[2] * minors[2]
    both = alone + low_pass * (xx + yy - low_pass)
    factor = (alone / both.maximum(1e-36)).sqrt()
    opacity = projection.opacity * (projection.antialiased * (factor - 1.0) + 1.0)
    radius = radius_of(opacity)
    first = xx.maximum(1e-24).sqrt()
    second = xy / first
    third = (yy - second * second).maximum(1e-24).sqrt()
    first_column = vector(tree, "ADD", vector(tree, "SCALE", right, first), vector(tree, "SCALE", up, second))
    columns = [
        vector(tree, "SCALE", first_column, radius),
        vector(tree, "SCALE", up, third * radius),
        # A card has no thickness, but Cycles needs an invertible matrix.
        vector(tree, "SCALE", forward, third * radius),
        center,
    ]
    square = new_node(tree, "GeometryNodeMeshGrid", Size__X=2.0, Size__Y=2.0, Vertices__X=2, Vertices__Y=2)
    instances = new_node(
        tree,
        "GeometryNodeInstanceOnPoints",
        Points=_with_opacity(tree, cutoff.points, opacity),
        Selection=cutoff.drawn * (depth > _RASTER.near) * (opacity > ALPHA_MIN),
        Instance=_with_material(tree, square.outputs["Mesh"], flat=True),
    )
    placed = new_node(
        tree,
        "GeometryNodeSetInstanceTransform",
        Instances=instances.outputs["Instances"],
        Transform=_matrix(tree, columns),
    )
    return placed.outputs["Instances"]


def _with_opacity(tree: bpy.types.NodeTree, points: Any, opacity: Formula) -> Any:
    """Return the points with another opacity in the attribute that the material reads."""
    stored = named_attribute(tree, COLOR_ATTRIBUTE, "FLOAT_COLOR")
    parts = new_node(tree, "FunctionNodeSeparateColor", Color=stored).outputs
    combined = tree.nodes.new("FunctionNodeCombineColor")
    for socket, channel in zip(combined.inputs, parts, strict=False):
        connect(tree, socket, channel)
    connect(tree, combined.inputs["Alpha"], opacity)
    return store_color(tree, points, combined.outputs[0])


def store_color(tree: bpy.types.NodeTree, geometry: Any, color: Any) -> Any:
    """Return the geometry with `color` in the attribute that the material reads."""
    settings = {"data_type": "FLOAT_COLOR", "domain": "POINT"}
    node = new_node(
        tree, "GeometryNodeStoreNamedAttribute", settings, Geometry=geometry, Name=COLOR_ATTRIBUTE, Value=color
    )
    return node.outputs["Geometry"]


def active_camera(tree: bpy.types.NodeTree) -> Any:
    """Return the outputs of a node about the active camera, in the frame of the object."""
    camera = tree.nodes.new("GeometryNodeInputActiveCamera").outputs[0]
    return new_node(tree, "GeometryNodeObjectInfo", {"transform_space": "RELATIVE"}, Object=camera).outputs


def _with_material(tree: bpy.types.NodeTree, mesh: Any, *, flat: bool) -> Any:
    return new_node(tree, "GeometryNodeSetMaterial", Geometry=mesh, Material=splat_material(flat=flat)).outputs[0]


def _camera_axes(tree: bpy.types.NodeTree) -> tuple[Any, Any, Any, Any]:
    """Return the right, up and forward unit vectors and the position of the camera, in the frame of the object."""
    camera, axes = active_camera(tree), []
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)):
        turned = new_node(tree, "FunctionNodeTransformDirection", Direction=axis, Transform=camera["Transform"])
        axes.append(vector(tree, "NORMALIZE", turned.outputs[0]))
    return axes[0], axes[1], axes[2], camera["Location"]


def _ellipsoid_axes(tree: bpy.types.NodeTree) -> list[Any]:
    """Return the three principal axes of each Gaussian, one standard deviation long."""
    rotation = named_attribute(tree, "rotation", "QUATERNION")
    scale = named_attribute(tree, "scale", "FLOAT_VECTOR")
    axes = []
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        own = vector(tree, "MULTIPLY", scale, axis)
        axes.append(new_node(tree, "FunctionNodeRotateVector", Vector=own, Rotation=rotation).outputs[0])
    return axes


def _matrix(tree: bpy.types.NodeTree, columns: list[Any]) -> Any:
    node = tree.nodes.new("FunctionNodeCombineMatrix")
    for number, column in enumerate(columns):
        parts = new_node(tree, "ShaderNodeSeparateXYZ", Vector=column)
        # In column-major order. The last row keeps its default, that of the identity.
        for row in range(3):
            connect(tree, node.inputs[4 * number + row], parts.outputs[row])
    return node.outputs[0]
