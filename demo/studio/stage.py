# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene is, and what its room is furnished with: exhibits in their places, frames, a sky and lamps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import radians

import bpy
from mathutils import Matrix, Vector

from .materials import linear
from .meshes import Point2, Point3, box, quad
from .views import Walk

Parts = list[bpy.types.Object]
SEEN_THROUGH = "seen_through"
"""A property of objects that masks are rendered without: panes, whose pixels are what is behind them."""


@dataclass(frozen=True)
class Place:
    """Where an exhibit is: its base, its turn about Z in degrees, its size, and its plinth's stone.

    `kind` is what builds it and `prompt` what it is asked for by, its name if they are empty; equal exhibits share
    both.
    """

    name: str
    x: float
    y: float
    z: float
    turn: float = 0.0
    scale: float = 1.0
    stone: str = ""
    kind: str = ""
    prompt: str = ""


@dataclass(frozen=True)
class Scene:
    """What is photographed, and how.

    Attributes
    ----------
    title
        Of every photo.
    build
        Fills the empty scene; `places` are its exhibits, whose instance ids count from 1.
    centre
        What the walks go around.
    photos, samples
        How many there are, and how many samples a pixel gets.
    bounces
        Of light, from one mirror-like or glassy surface to the next.
    """

    title: str
    build: Callable[[], None]
    places: Sequence[Place]
    walks: Sequence[Walk]
    centre: Point2
    photos: int
    samples: int
    bounces: int = 1


def exhibit(place: Place, identity: int, builders: Mapping[str, Callable[[], Parts]]) -> None:
    """Build one exhibit where it belongs."""
    pose = (
        Matrix.Translation((place.x, place.y, place.z))
        @ Matrix.Rotation(radians(place.turn), 4, "Z")
        @ Matrix.Scale(place.scale, 4)
    )
    for part in builders[place.kind or place.name]():
        # matrix_world of a new object is not evaluated yet, matrix_basis is.
        part.matrix_world = pose @ part.matrix_basis
        part.pass_index = identity


def frame(wide: float, tall: float, edge: float, material: bpy.types.Material) -> Parts:
    """Build a frame around the middle of a wall, `edge` wide, facing -Y."""
    parts = []
    for side in (-1, 1):
        parts.append(box("Frame", (wide + 2 * edge, 0.05, edge), (0, -0.02, side * (tall + edge) / 2), material, 0.015))
        parts.append(box("Frame", (edge, 0.05, tall), (side * (wide + edge) / 2, -0.02, 0), material, 0.015))
    return parts


def upright(name: str, wide: float, tall: float, y: float, material: bpy.types.Material) -> bpy.types.Object:
    """Make a textured rectangle that stands around the middle of a wall, facing -Y."""
    corners = [(-wide / 2, y, -tall / 2), (wide / 2, y, -tall / 2), (wide / 2, y, tall / 2), (-wide / 2, y, tall / 2)]
    return quad(name, corners, material)


def turned_to(parts: Parts, where: Point3, degrees: float) -> None:
    """Turn things about Z and put them somewhere."""
    for part in parts:
        part.matrix_world = Matrix.Translation(where) @ Matrix.Rotation(radians(degrees), 4, "Z") @ part.matrix_basis


def sky(colour: str, strength: float) -> None:
    """Give the scene a world of one colour; what has no ceiling is lit by it."""
    world = bpy.data.worlds.new("Sky")
    world.use_nodes = True
    inputs = world.node_tree.nodes["Background"].inputs
    inputs["Color"].default_value, inputs["Strength"].default_value = linear(colour), strength
    bpy.context.scene.world = world


def lamp(name: str, where: Point3, aim: Point3, wide: float, tall: float, watts: float, colour: str) -> None:
    """Add a rectangular area light that the camera does not see."""
    data = bpy.data.lights.new(name, "AREA")
    data.shape, data.size, data.size_y, data.energy, data.color = (
        "RECTANGLE",
        wide,
        tall,
        watts,
        linear(colour)[:3],
    )
    made = bpy.data.objects.new(name, data)
    made.location = where
    made.rotation_euler = (Vector(aim) - Vector(where)).to_track_quat("-Z", "Y").to_euler()
    made.visible_camera = False
    bpy.context.scene.collection.objects.link(made)
