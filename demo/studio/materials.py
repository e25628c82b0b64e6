# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural materials: Principled surfaces whose colour varies in space.

Patterns depend on the world position, not on the object, so that no two plinths or stones have the same pattern, which
structure from motion would match.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

Stops = Sequence[tuple[float, str]]


def linear(colour: str) -> tuple[float, float, float, float]:
    """Convert '#rrggbb' in sRGB to a linear RGBA tuple."""
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    rgb = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return (*rgb.tolist(), 1.0)


class Graph:
    """A material with a node tree, and short methods to add nodes to it."""

    def __init__(self, name: str, roughness: float, metallic: float) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.surface = self.tree.nodes["Principled BSDF"]
        self.surface.inputs["Roughness"].default_value = roughness
        self.surface.inputs["Metallic"].default_value = metallic

    def node(self, kind: str, **inputs: object) -> bpy.types.Node:
        """Add a node; inputs are values, or output sockets to link from."""
        made = self.tree.nodes.new(kind)
        for key, value in inputs.items():
            socket = made.inputs[key]
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return made

    def link(self, output: bpy.types.NodeSocket, name: str) -> None:
        """Link an output to an input of the surface."""
        self.tree.links.new(output, self.surface.inputs[name])

    def noise(
        self, scale: float, detail: float = 4, distortion: float = 0, stretch: Sequence[float] = (1, 1, 1)
    ) -> bpy.types.NodeSocket:
        """Add fractal noise over the world position."""
        position = self.node("ShaderNodeNewGeometry").outputs["Position"]
        if tuple(stretch) != (1, 1, 1):
            position = self.node("ShaderNodeMapping", Vector=position, Scale=stretch).outputs[0]
        made = self.node("ShaderNodeTexNoise", Vector=position, Scale=scale, Detail=detail, Distortion=distortion)
        return made.outputs["Fac"]

    def ramp(self, factor: bpy.types.NodeSocket, stops: Stops) -> bpy.types.NodeSocket:
        """Map a factor to colours."""
        made = self.node("ShaderNodeValToRGB", Fac=factor)
        elements = made.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (position, colour) in zip(elements, stops, strict=True):
            element.position, element.color = position, linear(colour)
        return made.outputs["Color"]

    def blend(
        self,
        kind: str,
        factor: float | bpy.types.NodeSocket,
        a: bpy.types.NodeSocket,
        b: bpy.types.NodeSocket,
    ) -> bpy.types.NodeSocket:
        """Mix two colours."""
        made = self.tree.nodes.new("ShaderNodeMix")
        made.data_type, made.blend_type = "RGBA", kind
        # The Mix node has sockets of equal names for every data type; these are the colour ones.
        for index, value in ((0, factor), (6, a), (7, b)):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, made.inputs[index])
            else:
                made.inputs[index].default_value = value
        return made.outputs[2]

    def bump(self, height: bpy.types.NodeSocket, strength: float, distance: float) -> None:
        """Add bump mapping with a height."""
        made = self.node("ShaderNodeBump", Height=height, Strength=strength, Distance=distance)
        self.link(made.outputs[0], "Normal")


def mottled(
    name: str,
    stops: Stops,
    scale: float,
    roughness: float = 0.7,
    metallic: float = 0.0,
    detail: float = 4,
    distortion: float = 0.0,
    stretch: Sequence[float] = (1, 1, 1),
    speckle: float = 0.25,
    speckle_scale: float = 90.0,
    bump: float = 0.15,
) -> bpy.types.Material:
    """Create stone, plaster, metal or wood: a large pattern with a fine speckle and a slight relief."""
    graph = Graph(name, roughness, metallic)
    large = graph.noise(scale, detail, distortion, stretch)
    fine = graph.noise(speckle_scale, 1, 0, stretch)
    speckles = graph.ramp(fine, [(0.36, "#555555"), (0.62, "#ffffff")])
    graph.link(graph.blend("MULTIPLY", speckle, graph.ramp(large, stops), speckles), "Base Color")
    graph.bump(fine, bump, 0.01)
    return graph.material


def painted(
    name: str,
    picture: np.ndarray,
    roughness: float = 0.6,
    metallic: float = 0.0,
    wear: float = 0.3,
    wear_scale: float = 14.0,
    bump: float = 0.0,
) -> bpy.types.Material:
    """Create a material with a picture as texture, stained by noise; `bump` lowers its dark parts."""
    graph = Graph(name, roughness, metallic)
    texture = graph.tree.nodes.new("ShaderNodeTexImage")
    texture.image = image(name, picture)
    stains = graph.ramp(graph.noise(wear_scale, 4), [(0.35, "#8a8a8a"), (0.6, "#ffffff")])
    graph.link(graph.blend("MULTIPLY", wear, texture.outputs["Color"], stains), "Base Color")
    if bump:
        graph.bump(texture.outputs["Color"], bump, 0.01)
    return graph.material


def plain(name: str, colour: str, roughness: float = 0.6, metallic: float = 0.0) -> bpy.types.Material:
    """Create a material of one colour, for small parts."""
    graph = Graph(name, roughness, metallic)
    graph.surface.inputs["Base Color"].default_value = linear(colour)
    return graph.material


def bronze(name: str) -> bpy.types.Material:
    """Create brown bronze with traces of verdigris."""
    stops = [(0.3, "#5f3d1c"), (0.5, "#9a6a32"), (0.6, "#a97b40"), (0.72, "#6c7a58")]
    return mottled(name, stops, 9, roughness=0.45, metallic=0.65, speckle=0.5, bump=0.25)


def wood(name: str, dark: str, light: str) -> bpy.types.Material:
    """Create turned wood with upright grain."""
    stops = [(0.3, dark), (0.5, light), (0.58, dark), (0.75, light)]
    return mottled(name, stops, 7, 0.45, distortion=0.6, stretch=(5, 5, 0.8), speckle=0.45, bump=0.1)


def thin_glass(name: str, tint: str, veil: float) -> bpy.types.Material:
    """Create glass without refraction, which is cheap to render and can be reconstructed."""
    graph = Graph(name, 0.12, 0.0)
    graph.surface.inputs["Base Color"].default_value = linear(tint)
    clear = graph.node("ShaderNodeBsdfTransparent", Color=linear("#eef4f0"))
    facing = graph.node("ShaderNodeLayerWeight", Blend=0.15).outputs["Facing"]
    amount = graph.node("ShaderNodeMapRange", Value=facing)
    amount.inputs["To Min"].default_value, amount.inputs["To Max"].default_value = veil, 0.9
    # The glass casts no shadow on its contents.
    lit = graph.node("ShaderNodeLightPath").outputs["Is Shadow Ray"]
    seen = graph.node("ShaderNodeMapRange", Value=lit, **{"To Min": amount.outputs[0], "To Max": 0.0})
    mixed = graph.tree.nodes.new("ShaderNodeMixShader")
    output = graph.tree.nodes["Material Output"]
    for source, target in (
        (seen.outputs[0], mixed.inputs[0]),
        (clear.outputs[0], mixed.inputs[1]),
        (graph.surface.outputs[0], mixed.inputs[2]),
        (mixed.outputs[0], output.inputs["Surface"]),
    ):
        graph.tree.links.new(source, target)
    return graph.material


def mirror(name: str, tint: str) -> bpy.types.Material:
    """Create a mirror."""
    return plain(name, tint, 0.02, 1.0)


def image(name: str, picture: np.ndarray) -> bpy.types.Image:
    """Return a Blender image of an (h, w, 3) uint8 sRGB picture, first row at the top."""
    height, width = picture.shape[:2]
    made = bpy.data.images.new(name, width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = picture[::-1] / np.float32(255)
    made.pixels.foreach_set(rgba.ravel())
    made.update()
    return made


def instance_id() -> bpy.types.Material:
    """Create a material that emits (object index / 255) and replaces all materials when masks are rendered."""
    graph = Graph("Instance id", 1.0, 0.0)
    index = graph.node("ShaderNodeObjectInfo").outputs["Object Index"]
    scaled = graph.tree.nodes.new("ShaderNodeMath")
    scaled.operation = "DIVIDE"
    scaled.inputs[1].default_value = 255
    graph.tree.links.new(index, scaled.inputs[0])
    glow = graph.node("ShaderNodeEmission", Strength=scaled.outputs[0], Color=(1, 1, 1, 1))
    graph.tree.links.new(glow.outputs[0], graph.tree.nodes["Material Output"].inputs["Surface"])
    return graph.material


def depth() -> bpy.types.Material:
    """Create a material that emits the depth along the optical axis and replaces all materials."""
    graph = Graph("Depth", 1.0, 0.0)
    distance = graph.node("ShaderNodeCameraData").outputs["View Z Depth"]
    glow = graph.node("ShaderNodeEmission", Strength=distance, Color=(1, 1, 1, 1))
    graph.tree.links.new(glow.outputs[0], graph.tree.nodes["Material Output"].inputs["Surface"])
    return graph.material
