"""Geometry nodes that put a shape on each Gaussian: ellipsoids to work with, flat cards for the final picture.

Ellipsoids look right from everywhere. Cards face the active camera and are the engine's own projection (Zwicker et
al. 2001, as in Kerbl et al. 2023): the ellipse of the linearised projection, lying in the plane through the
Gaussian's centre, so that they are sorted by depth of their centres too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy

from .node_math import Formula, connect, named_attribute, new_node, scale_vector, vector
from .splat_material import splat_material

__all__ = ["Cut", "View", "add_cards", "add_ellipsoids"]

_ICOSAHEDRON_RADIUS = 1.2584086
"""Of the corners when the faces touch the unit sphere: the ellipsoid lies inside."""
_LOW_PASS = 0.3
"""Pixels^2 that the engine adds to both variances on the screen (`RasterSettings.low_pass`)."""
_NEAR = 0.02
"""Of the engine (`RasterSettings.near`)."""


@dataclass(frozen=True)
class Cut:
    """Where a Gaussian ends.

    Attributes
    ----------
    points : socket
        Points with the attributes of `splats`.
    drawn : Formula
        1 for Gaussians that are drawn.
    radius : Formula
        In standard deviations, where the density falls to 1/255.
    """

    points: Any
    drawn: Formula
    radius: Formula


@dataclass(frozen=True)
class View:
    """What the cards need of the camera besides its pose.

    Attributes
    ----------
    pixel : Formula
        Size of a pixel at distance 1, for the engine's low-pass; 0 for none.
    low, high : sequence of Formula
        Bounds of X/Z and Y/Z (right and up over depth) where the projection is linearised.
    """

    pixel: Formula
    low: Sequence[Formula]
    high: Sequence[Formula]


def add_ellipsoids(tree: bpy.types.NodeTree, cut: Cut) -> Any:
    """Return instances of an icosahedron around each Gaussian's cut-off."""
    shape = new_node(tree, "GeometryNodeMeshIcoSphere", Radius=_ICOSAHEDRON_RADIUS, Subdivisions=1)
    painted = _painted(tree, shape.outputs["Mesh"], flat=False)
    instances = new_node(
        tree,
        "GeometryNodeInstanceOnPoints",
        Points=cut.points,
        Selection=cut.drawn,
        Instance=painted,
        Rotation=named_attribute(tree, "rotation", "QUATERNION"),
        Scale=scale_vector(tree, named_attribute(tree, "scale", "FLOAT_VECTOR"), cut.radius),
    )
    return instances.outputs["Instances"]


def add_cards(tree: bpy.types.NodeTree, cut: Cut, view: View) -> Any:
    """Return instances of a square that holds each Gaussian's ellipse as the active camera sees it.

    Parameters
    ----------
    tree : NodeTree
    cut : Cut
    view : View

    Notes
    -----
    With A = R S the ellipsoid's axes in camera coordinates and (X, Y, Z) its centre, the ellipse at depth Z has the
    covariance ``T A (T A)^T``, ``T = [[1, 0, -X/Z], [0, 1, -Y/Z]]``. The columns of its Cholesky factor span the card.
    X/Z and Y/Z in T are held within the bounds of the view: beside the camera they would grow beyond all measure, and
    its card would cover the picture.
    """
    right, up, forward, origin = _camera_axes(tree)
    center = tree.nodes.new("GeometryNodeInputPosition").outputs[0]
    offset = vector(tree, "SUBTRACT", center, origin)

    def along(axis: Any, other: Any) -> Formula:
        return Formula(tree, vector(tree, "DOT_PRODUCT", axis, other, output="Value"))

    depth = along(forward, offset)
    slope_x = (along(right, offset) / depth).maximum(view.low[0]).minimum(view.high[0])
    slope_y = (along(up, offset) / depth).maximum(view.low[1]).minimum(view.high[1])
    low_pass = view.pixel * view.pixel * depth * depth * _LOW_PASS
    xx, xy, yy = low_pass, Formula(tree, 0.0), low_pass
    for own_axis in _own_axes(tree):
        away = along(forward, own_axis)
        x, y = along(right, own_axis) - slope_x * away, along(up, own_axis) - slope_y * away
        xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
    first = xx.maximum(1e-24).sqrt()
    second = xy / first
    third = (yy - second * second).maximum(1e-24).sqrt()
    sideways = vector(tree, "ADD", scale_vector(tree, right, first), scale_vector(tree, up, second))
    columns = [
        scale_vector(tree, sideways, cut.radius),
        scale_vector(tree, up, third * cut.radius),
        # A card has no thickness, but Cycles needs a matrix that can be inverted.
        scale_vector(tree, forward, third * cut.radius),
        center,
    ]
    square = new_node(tree, "GeometryNodeMeshGrid", Size__X=2.0, Size__Y=2.0, Vertices__X=2, Vertices__Y=2)
    instances = new_node(
        tree,
        "GeometryNodeInstanceOnPoints",
        Points=cut.points,
        Selection=cut.drawn * (depth > _NEAR),
        Instance=_painted(tree, square.outputs["Mesh"], flat=True),
    )
    placed = new_node(
        tree,
        "GeometryNodeSetInstanceTransform",
        Instances=instances.outputs["Instances"],
        Transform=_matrix(tree, columns),
    )
    return placed.outputs["Instances"]


def _painted(tree: bpy.types.NodeTree, mesh: Any, *, flat: bool) -> Any:
    return new_node(tree, "GeometryNodeSetMaterial", Geometry=mesh, Material=splat_material(flat=flat)).outputs[0]


def _camera_axes(tree: bpy.types.NodeTree) -> tuple[Any, Any, Any, Any]:
    """Return the camera's right, up and forward as unit vectors and its position, in the object's own frame."""
    camera = new_node(
        tree,
        "GeometryNodeObjectInfo",
        {"transform_space": "RELATIVE"},
        Object=tree.nodes.new("GeometryNodeInputActiveCamera").outputs[0],
    )
    axes = []
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)):
        turned = new_node(tree, "FunctionNodeTransformDirection", Direction=axis, Transform=camera.outputs["Transform"])
        axes.append(vector(tree, "NORMALIZE", turned.outputs[0]))
    return axes[0], axes[1], axes[2], camera.outputs["Location"]


def _own_axes(tree: bpy.types.NodeTree) -> list[Any]:
    """Return the three own axes of a Gaussian, each one standard deviation long."""
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
        # Column by column; the last row stays that of the identity.
        for row in range(3):
            connect(tree, node.inputs[4 * number + row], parts.outputs[row])
    return node.outputs[0]
