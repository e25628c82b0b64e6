"""The geometry nodes that draw a mesh of Gaussians: one shape per Gaussian, coloured as seen by the active camera."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from ...engine.rasterizer.settings import ALPHA_MIN
from ..blender.node_math import Formula, connect, named_attribute, new_node, separate_xyz, vector
from .splat_shapes import (
    Cutoff,
    Projection,
    active_camera,
    add_cards,
    add_ellipsoids,
    add_solids,
    radius_of,
    store_color,
)

DISPLAY = "Gaussian Splats"
"""Name of the modifier."""
_GROUP_PREFIX = f".{DISPLAY}"
"""Begin of the names of its node groups. Because of the dot, Blender does not offer them for other objects."""
THRESHOLD = "Threshold"
AS_TRAINED = "Blend as Trained"
ANTIALIASED = "Anti-Aliased"
ANTIALIASED_KEY = "heritage_antialiased"
"""Custom property: whether the Gaussians of an object were trained anti-aliased."""
PIXEL = "Pixel Size"
SOLID = "Solid Shapes"
SHAPES = "Shapes in Viewport"
VIEW_LOW, VIEW_HIGH = "View Low", "View High"
"""Inputs of the modifier, see `_display_group`."""
_BEYOND = "Bound of x and y divided by depth; Gaussians beyond it are projected as if they were on it"
_INPUTS = {
    THRESHOLD: ("NodeSocketFloat", "Gaussians with a lower membership in the object are hidden"),
    AS_TRAINED: ("NodeSocketBool", "Blend sRGB values, as in training; needs the view transform Raw"),
    ANTIALIASED: (
        "NodeSocketBool", "Reduce the opacity of a Gaussian by as much as the low-pass filter widens it"
    ),
    PIXEL: (
        "NodeSocketFloat", "Size of a pixel at distance 1, for the low-pass filter used in training; 0 turns it off"
    ),
    SOLID: ("NodeSocketBool", "Draw opaque shapes in the viewport, as the modes Solid and Wireframe need them"),
    SHAPES: ("NodeSocketBool", "Let the viewport draw a shape for each Gaussian; otherwise, only their bounds"),
    VIEW_LOW: ("NodeSocketVector", _BEYOND),
    VIEW_HIGH: ("NodeSocketVector", _BEYOND),
}  # fmt: skip
"""Type and description of each input."""
_SH_C0 = 0.28209479177387814
_SOLID_OPACITY = 0.15
"""Fainter Gaussians are left out where all that is drawn is opaque."""


def add_display(obj: bpy.types.Object, sh_degree: int) -> None:
    """Add the modifier that draws `obj`, a mesh with the attributes described in `splats`."""
    modifier = obj.modifiers.new(DISPLAY, "NODES")
    modifier.node_group = _display_group(sh_degree)
    show_in_edit_mode(obj, shapes=False)


def show_in_edit_mode(obj: bpy.types.Object, *, shapes: bool) -> None:
    """Let Blender draw the shapes in Edit Mode too, or nothing: the corners of the bounds would look like Gaussians."""
    modifier = obj.modifiers.get(DISPLAY)
    if modifier is not None and modifier.show_in_editmode != shapes:
        modifier.show_in_editmode = shapes


def set_display_input(obj: bpy.types.Object, name: str, value: float | bool | tuple[float, float, float]) -> None:
    """Set an input of the display modifier of `obj`; do nothing when the user has removed or replaced it."""
    modifier = obj.modifiers.get(DISPLAY)
    identifier = _identifier(modifier, name)
    if identifier is None:
        return
    if bpy.app.version >= (5, 2, 0):
        getattr(modifier.properties.inputs, identifier).value = value
    else:
        modifier[identifier] = value
    obj.update_tag()


def display_input(obj: bpy.types.Object, name: str) -> Any:
    """Return an input of the display modifier of `obj`; None when the user has removed or replaced it."""
    modifier = obj.modifiers.get(DISPLAY)
    identifier = _identifier(modifier, name)
    if identifier is None:
        return None
    has_inputs = bpy.app.version >= (5, 2, 0)
    value = getattr(modifier.properties.inputs, identifier).value if has_inputs else modifier[identifier]
    # Blender frees an array of its own when the node group is replaced.
    return tuple(value) if _INPUTS[name][0] == "NodeSocketVector" else value


def _identifier(modifier: bpy.types.Modifier | None, name: str) -> str | None:
    tree = modifier.node_group if modifier is not None and modifier.type == "NODES" else None
    return None if tree is None else _inputs(tree).get((name, _INPUTS[name][0]))


def _inputs(tree: bpy.types.NodeTree) -> dict[tuple[str, str], str]:
    """Return the identifiers of the inputs of a node group by name and type."""
    sockets = (item for item in tree.interface.items_tree if item.item_type == "SOCKET" and item.in_out == "INPUT")
    return {(socket.name, socket.socket_type): socket.identifier for socket in sockets}


def _display_group(sh_degree: int) -> bpy.types.NodeTree:
    name = f"{_GROUP_PREFIX} {sh_degree}"
    wanted = {(own, kind) for own, (kind, _) in _INPUTS.items()}
    for tree in bpy.data.node_groups:
        # A file from someone else may contain another group of that name.
        if tree.name.startswith(name) and tree.type == "GEOMETRY" and wanted <= set(_inputs(tree)):
            return tree
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.is_modifier = True
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    for own, (kind, description) in _INPUTS.items():
        socket = tree.interface.new_socket(own, in_out="INPUT", socket_type=kind)
        socket.description = description
        if kind == "NodeSocketVector":
            sign = -1.0 if own == VIEW_LOW else 1.0
            socket.default_value = (sign, sign, 0.0)
    _build(tree, sh_degree)
    return tree


def _build(tree: bpy.types.NodeTree, sh_degree: int) -> None:
    inputs = tree.nodes.new("NodeGroupInput").outputs
    base = named_attribute(tree, "radiance:base", "FLOAT_COLOR")
    opacity = Formula(tree, new_node(tree, "FunctionNodeSeparateColor", Color=base).outputs["Alpha"])
    color = _srgb_color(tree, base, sh_degree)
    combined = tree.nodes.new("FunctionNodeCombineColor")
    as_trained = Formula(tree, inputs[AS_TRAINED])
    for socket, channel in zip(combined.inputs, separate_xyz(tree, color), strict=False):
        positive = channel.maximum(0.0)
        linear = _linear_from_srgb(positive)
        connect(tree, socket, linear + as_trained * (positive - linear))
    connect(tree, combined.inputs["Alpha"], opacity)
    with_color = store_color(tree, inputs["Geometry"], combined.outputs[0])
    membership = Formula(tree, named_attribute(tree, "membership", "FLOAT"))
    belongs = Formula(tree, 1.0) - (membership < Formula(tree, inputs[THRESHOLD]))
    points = new_node(tree, "GeometryNodeMeshToPoints", Mesh=with_color)
    cutoff = Cutoff(
        points=points.outputs["Points"],
        # A Gaussian with a lower opacity is invisible.
        drawn=belongs * (opacity > ALPHA_MIN),
        radius=radius_of(opacity),
    )
    solid = replace(cutoff, drawn=belongs * (opacity > _SOLID_OPACITY))
    low, high = (separate_xyz(tree, inputs[bound]) for bound in (VIEW_LOW, VIEW_HIGH))
    projection = Projection(Formula(tree, inputs[PIXEL]), low, high, Formula(tree, inputs[ANTIALIASED]), opacity)
    solids = add_solids(tree, solid, with_color)
    viewport = _choice(tree, inputs[SOLID], solids, add_ellipsoids(tree, cutoff))
    viewport = _choice(tree, inputs[SHAPES], viewport, _corners(tree, solid, inputs["Geometry"]))
    is_viewport = tree.nodes.new("GeometryNodeIsViewport").outputs[0]
    shapes = _choice(tree, is_viewport, viewport, add_cards(tree, cutoff, projection))
    output = tree.nodes.new("NodeGroupOutput")
    tree.links.new(shapes, output.inputs["Geometry"])


def _corners(tree: bpy.types.NodeTree, cutoff: Cutoff, mesh: Any) -> Any:
    """Return the corners of the box around the centres of the Gaussians that are drawn, for Blender's bounds.

    They are points without a size, as Blender would draw vertices.
    """
    drawn = new_node(tree, "GeometryNodeSeparateGeometry", Geometry=mesh, Selection=cutoff.drawn)
    box = new_node(tree, "GeometryNodeBoundBox", Geometry=drawn.outputs["Selection"])
    return new_node(tree, "GeometryNodeMeshToPoints", Mesh=box.outputs["Bounding Box"], Radius=0.0).outputs["Points"]


def _choice(tree: bpy.types.NodeTree, condition: Any, if_true: Any, if_false: Any) -> Any:
    """Return one of two geometries; only that one is computed."""
    node = new_node(
        tree,
        "GeometryNodeSwitch",
        {"input_type": "GEOMETRY"},
        Switch=condition,
        **{"True": if_true, "False": if_false},
    )
    return node.outputs[0]


def _srgb_color(tree: bpy.types.NodeTree, base: Any, sh_degree: int) -> Any:
    """Return ``0.5 + sum_k basis_k(direction from the camera) sh_k`` as a vector."""
    total = vector(tree, "SCALE", base, Formula(tree, _SH_C0))
    if sh_degree > 0:
        position = tree.nodes.new("GeometryNodeInputPosition").outputs[0]
        offset = vector(tree, "SUBTRACT", position, active_camera(tree)["Location"])
        direction = vector(tree, "NORMALIZE", offset)
        for index, basis in enumerate(_sh_basis(separate_xyz(tree, direction), sh_degree)):
            coefficient = named_attribute(tree, f"radiance:sh_{index}", "FLOAT_VECTOR")
            total = vector(tree, "ADD", total, vector(tree, "SCALE", coefficient, basis))
    return vector(tree, "ADD", total, (0.5, 0.5, 0.5))


def _sh_basis(direction: Any, degree: int) -> list[Formula]:
    """Return the functions of `engine.formats.spherical_harmonics.sh_basis`, except the first, as nodes."""
    x, y, z = direction
    basis = [y * -0.4886025119029199, z * 0.4886025119029199, x * -0.4886025119029199]
    if degree >= 2:
        xx, yy, zz = x * x, y * y, z * z
        basis += [
            x * y * 1.0925484305920792,
            y * z * -1.0925484305920792,
            (zz * 2.0 - xx - yy) * 0.31539156525252005,
            x * z * -1.0925484305920792,
            (xx - yy) * 0.5462742152960396,
        ]
    if degree >= 3:
        basis += [
            y * (xx * 3.0 - yy) * -0.5900435899266435,
            x * y * z * 2.890611442640554,
            y * (zz * 4.0 - xx - yy) * -0.4570457994644658,
            z * (zz * 2.0 - xx * 3.0 - yy * 3.0) * 0.3731763325901154,
            x * (zz * 4.0 - xx - yy) * -0.4570457994644658,
            z * (xx - yy) * 1.445305721320277,
            x * (xx - yy * 3.0) * -0.5900435899266435,
        ]
    return basis


def _linear_from_srgb(srgb: Formula) -> Formula:
    """Decode sRGB as in IEC 61966-2-1, extended above 1."""
    dark = srgb < 0.04045
    low, high = srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4
    return high + dark * (low - high)
