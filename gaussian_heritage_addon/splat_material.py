"""The materials that draw one Gaussian on its shape."""

from __future__ import annotations

import bpy

from .node_math import Formula, connect, new_node, vector

__all__ = ["COLOR_ATTRIBUTE", "splat_material"]

COLOR_ATTRIBUTE = "heritage_color"
"""Colour and opacity of an instance, computed by the node group."""
_MOST = 0.99
"""Alpha is clamped to this, as in the engine (`ALPHA_MAX`)."""


def splat_material(*, flat: bool) -> bpy.types.Material:
    """Return the material for cards (`flat`) or ellipsoids, built when the file has none yet.

    Notes
    -----
    With opacity ``a`` and the cut-off where the density falls to 1/255, the density at the fraction ``r`` of the way
    from the centre to the cut-off is ``a (255 a)^(-r^2)``. In object space the cut-off has radius 1: on a card ``r`` is
    the distance from its middle; a ray through point ``o`` of an ellipsoid with unit direction ``d`` passes the centre
    at ``r = |o x d|``, without the loss of digits of ``|o|^2 - (o.d)^2``. An ellipsoid is drawn once, on its front.
    """
    name = "Gaussian Splat Card" if flat else "Gaussian Splat Ellipsoid"
    material = bpy.data.materials.get(name)
    if material is not None:
        return material
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    # Otherwise Cycles would treat every Gaussian as a lamp and build a light tree of them.
    material.cycles.emission_sampling = "NONE"
    material.surface_render_method = "BLENDED"
    tree = material.node_tree
    tree.nodes.clear()
    instance = new_node(tree, "ShaderNodeAttribute", {"attribute_type": "INSTANCER", "attribute_name": COLOR_ATTRIBUTE})
    opacity = Formula(tree, instance.outputs["Alpha"])
    radius, visible = _on_card(tree) if flat else _through_ellipsoid(tree)
    squared = radius * radius
    density = opacity * (opacity * 255.0) ** -squared * (squared < 1.0) * visible
    emission = new_node(tree, "ShaderNodeEmission", Color=instance.outputs["Color"])
    clear = new_node(tree, "ShaderNodeBsdfTransparent")
    mix = tree.nodes.new("ShaderNodeMixShader")
    connect(tree, mix.inputs[0], density.minimum(_MOST))
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(emission.outputs[0], mix.inputs[2])
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def _on_card(tree: bpy.types.NodeTree) -> tuple[Formula, float]:
    point = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    return Formula(tree, vector(tree, "LENGTH", point, output="Value")), 1.0


def _through_ellipsoid(tree: bpy.types.NodeTree) -> tuple[Formula, Formula]:
    point = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    towards_camera = new_node(
        tree,
        "ShaderNodeVectorTransform",
        {"vector_type": "VECTOR", "convert_from": "WORLD", "convert_to": "OBJECT"},
        Vector=geometry.outputs["Incoming"],
    )
    direction = vector(tree, "NORMALIZE", towards_camera.outputs["Vector"])
    passing = vector(tree, "LENGTH", vector(tree, "CROSS_PRODUCT", point, direction), output="Value")
    return Formula(tree, passing), Formula(tree, geometry.outputs["Backfacing"]) < 0.5
