"""The two materials that draw a Gaussian: one for cards, one for ellipsoids."""

from __future__ import annotations

import bpy

from ...engine.rasterizer.settings import ALPHA_MAX, ALPHA_MIN
from ..blender.node_math import Formula, connect, new_node, vector

COLOR_ATTRIBUTE = "heritage_color"
"""Attribute with the colour and opacity of an instance, computed by the node group."""


def splat_material(*, flat: bool) -> bpy.types.Material:
    """Return the material for cards (`flat`) or ellipsoids. It is created when the file does not contain it yet.

    Notes
    -----
    A Gaussian of opacity ``a`` is cut off where its density falls to 1/255 (`ALPHA_MIN`). At the fraction ``r`` of the
    distance from its centre to the cut-off, the density is ``a (255 a)^(-r^2)``. In object space the cut-off has radius
    1. On a card, ``r`` is the distance from the centre. For an ellipsoid, ``r = |o x d|`` is the distance between the
    centre and the ray through point ``o`` with unit direction ``d``; ``|o|^2 - (o.d)^2`` would lose digits. Only the
    front of an ellipsoid is drawn.
    """
    name = "Gaussian Splat Card" if flat else "Gaussian Splat Ellipsoid"
    material = bpy.data.materials.get(name)
    if material is not None:
        return material
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    # Otherwise Cycles would treat every Gaussian as a lamp and build a light tree from them.
    material.cycles.emission_sampling = "NONE"
    material.surface_render_method = "BLENDED"
    tree = material.node_tree
    tree.nodes.clear()
    instance = new_node(tree, "ShaderNodeAttribute", {"attribute_type": "INSTANCER", "attribute_name": COLOR_ATTRIBUTE})
    opacity = Formula(tree, instance.outputs["Alpha"])
    radius, visible = _on_card(tree) if flat else _in_ellipsoid(tree)
    squared = radius * radius
    density = opacity * (opacity * (1.0 / ALPHA_MIN)) ** -squared * (squared < 1.0) * visible
    emission = new_node(tree, "ShaderNodeEmission", Color=instance.outputs["Color"])
    clear = new_node(tree, "ShaderNodeBsdfTransparent")
    mix = tree.nodes.new("ShaderNodeMixShader")
    connect(tree, mix.inputs[0], density.minimum(ALPHA_MAX))
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(emission.outputs[0], mix.inputs[2])
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def _on_card(tree: bpy.types.NodeTree) -> tuple[Formula, float]:
    """Return `r`, and 1 where the shape is drawn."""
    point = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    return Formula(tree, vector(tree, "LENGTH", point, output="Value")), 1.0


def _in_ellipsoid(tree: bpy.types.NodeTree) -> tuple[Formula, Formula]:
    """Return `r`, and 1 where the shape is drawn."""
    point = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    towards_camera = new_node(
        tree,
        "ShaderNodeVectorTransform",
        {"vector_type": "VECTOR", "convert_from": "WORLD", "convert_to": "OBJECT"},
        Vector=geometry.outputs["Incoming"],
    )
    direction = vector(tree, "NORMALIZE", towards_camera.outputs["Vector"])
    distance = vector(tree, "LENGTH", vector(tree, "CROSS_PRODUCT", point, direction), output="Value")
    return Formula(tree, distance), Formula(tree, geometry.outputs["Backfacing"]) < 0.5
