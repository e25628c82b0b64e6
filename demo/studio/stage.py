# SPDX-License-Identifier: GPL-3.0-or-later
"""Description of a scene, and functions to add exhibits, frames, a sky and lamps. World: Z up, metres."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import radians

import bpy
from mathutils import Matrix, Vector

from .materials import linear
from .meshes import box, quad
from .phone import Phone
from .shapes import Point2, Point3
from .views import Walk

Parts = list[bpy.types.Object]
SEEN_THROUGH = "seen_through"
"""Property of objects that are hidden in masks, such as panes: their pixels belong to the object behind them."""


@dataclass(frozen=True)
class Place:
    """Place of an exhibit: position of its base, rotation about Z in degrees, scale, and the stone of its plinth.

    `kind` selects its builder and `prompt` is its text prompt; both default to the name. Equal exhibits share both.
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
    """A scene and how it is photographed.

    Attributes
    ----------
    title
        Title of the photos, in their EXIF description.
    build
        Function that builds the scene in an empty one.
    places
        Places of the exhibits, whose instance ids count from 1.
    walks, centre
        Camera paths, and the point on the floor that they go around.
    photos, samples
        Number of photos, and of samples per pixel.
    bounces
        Maximum number of glossy reflections of a light path.
    phone
        The phone that takes the photos.
    """

    title: str
    build: Callable[[], None]
    places: Sequence[Place]
    walks: Sequence[Walk]
    centre: Point2
    photos: int
    samples: int
    bounces: int = 1
    phone: Phone = field(default_factory=Phone)


def exhibit(place: Place, identity: int, builders: Mapping[str, Callable[[], Parts]]) -> None:
    """Build an exhibit at its place."""
    pose = (
        Matrix.Translation((place.x, place.y, place.z))
        @ Matrix.Rotation(radians(place.turn), 4, "Z")
        @ Matrix.Scale(place.scale, 4)
    )
    for part in builders[place.kind or place.name]():
        # The matrix_world of a new object is not evaluated yet, so matrix_basis is used.
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
    """Build an upright textured rectangle around the middle of a wall, facing -Y."""
    corners = [(-wide / 2, y, -tall / 2), (wide / 2, y, -tall / 2), (wide / 2, y, tall / 2), (-wide / 2, y, tall / 2)]
    return quad(name, corners, material)


def turned_to(parts: Parts, where: Point3, degrees: float) -> None:
    """Rotate parts about Z and move them to `where`."""
    for part in parts:
        part.matrix_world = Matrix.Translation(where) @ Matrix.Rotation(radians(degrees), 4, "Z") @ part.matrix_basis


def sky(colour: str, strength: float) -> None:
    """Set a world background of one colour, which lights a room without a ceiling."""
    world = bpy.data.worlds.new("Sky")
    world.use_nodes = True
    inputs = world.node_tree.nodes["Background"].inputs
    inputs["Color"].default_value, inputs["Strength"].default_value = linear(colour), strength
    bpy.context.scene.world = world


def lamp(name: str, where: Point3, aim: Point3, wide: float, tall: float, watts: float, colour: str) -> None:
    """Add a rectangular area light that is invisible to the camera."""
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
