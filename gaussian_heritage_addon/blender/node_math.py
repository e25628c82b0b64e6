"""Builds node trees from formulas in Python: ``(a + 0.055) / 1.055`` becomes two Math nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

Socket = Any


def new_node(
    tree: bpy.types.NodeTree, kind: str, settings: dict[str, Any] | None = None, **inputs: Any
) -> bpy.types.Node:
    """Add a node, set its properties, and set or link its inputs.

    Parameters
    ----------
    kind : str
        ``bl_idname`` of the node.
    settings : dict, optional
        Properties of the node. They are set first, because they determine its inputs.
    inputs
        Identifier or name of an input (with ``__`` for a space) and its socket, `Formula` or value.
    """
    node = tree.nodes.new(kind)
    for name, value in (settings or {}).items():
        setattr(node, name, value)
    for name, value in inputs.items():
        connect(tree, _input(node, name.replace("__", " ")), value)
    return node


def _input(node: bpy.types.Node, identifier: str) -> Socket:
    # A node with several data types has one socket of the same name for each; only one of them is enabled.
    for socket in node.inputs:
        if socket.enabled and identifier in (socket.identifier, socket.name):
            return socket
    raise KeyError(f"{node.bl_idname} has no input {identifier!r}")


def connect(tree: bpy.types.NodeTree, target: Socket, value: Any) -> None:
    """Link `target` to a socket or a `Formula`, or set its value."""
    if isinstance(value, Formula):
        value = value.value
    if isinstance(value, bpy.types.NodeSocket):
        tree.links.new(value, target)
    else:
        target.default_value = value


class Formula:
    """A number in a node tree, a socket or a constant, that supports Python's operators."""

    def __init__(self, tree: bpy.types.NodeTree, value: Socket | float) -> None:
        self.tree = tree
        self.value = value

    def _math(self, operation: str, *operands: Formula | float) -> Formula:
        node = self.tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, operand in zip(node.inputs, operands, strict=False):
            connect(self.tree, socket, operand)
        return Formula(self.tree, node.outputs[0])

    def __add__(self, other: Formula | float) -> Formula:
        return self._math("ADD", self, other)

    def __sub__(self, other: Formula | float) -> Formula:
        return self._math("SUBTRACT", self, other)

    def __mul__(self, other: Formula | float) -> Formula:
        return self._math("MULTIPLY", self, other)

    def __truediv__(self, other: Formula | float) -> Formula:
        return self._math("DIVIDE", self, other)

    def __pow__(self, other: Formula | float) -> Formula:
        return self._math("POWER", self, other)

    def __neg__(self) -> Formula:
        return self._math("MULTIPLY", self, -1.0)

    __radd__ = __add__
    __rmul__ = __mul__

    def __lt__(self, other: Formula | float) -> Formula:
        """Return 1 where smaller, else 0."""
        return self._math("LESS_THAN", self, other)

    def __gt__(self, other: Formula | float) -> Formula:
        """Return 1 where greater, else 0."""
        return self._math("GREATER_THAN", self, other)

    def maximum(self, other: Formula | float) -> Formula:
        """Return the greater of the two."""
        return self._math("MAXIMUM", self, other)

    def minimum(self, other: Formula | float) -> Formula:
        """Return the smaller of the two."""
        return self._math("MINIMUM", self, other)

    def log(self) -> Formula:
        """Return the natural logarithm."""
        return self._math("LOGARITHM", self, 2.718281828459045)

    def sqrt(self) -> Formula:
        """Return the square root; 0 for negative numbers."""
        return self._math("SQRT", self)


def named_attribute(tree: bpy.types.NodeTree, name: str, data_type: str) -> Socket:
    """Return the values of an attribute; 0 where the geometry has no attribute of this name."""
    node = new_node(tree, "GeometryNodeInputNamedAttribute", {"data_type": data_type}, Name=name)
    return node.outputs["Attribute"]


def vector(tree: bpy.types.NodeTree, operation: str, *operands: Any, output: str = "Vector") -> Socket:
    """Add a Vector Math node and return its output."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    for socket, operand in zip([socket for socket in node.inputs if socket.enabled], operands, strict=False):
        connect(tree, socket, operand)
    return node.outputs[output]


def separate_xyz(tree: bpy.types.NodeTree, operand: Socket) -> Sequence[Formula]:
    """Return the three components of a vector."""
    node = new_node(tree, "ShaderNodeSeparateXYZ", Vector=operand)
    return [Formula(tree, socket) for socket in node.outputs]
