# SPDX-License-Identifier: GPL-3.0-or-later
"""The museum room: floor, walls, plinths, pictures, light and the places of the exhibits. World: Z up, metres."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix
from studio.materials import mottled, painted
from studio.meshes import box, quad
from studio.stage import Place, Scene, exhibit, frame, lamp, sky, turned_to, upright
from studio.textures import label
from studio.views import Walk

import pictures
from objects import BUILDERS

BACK, SIDE, FRONT, HEIGHT = 1.6, 2.95, -3.6, 3.8
SKY_STRENGTH = 0.85


# The instance ids in the masks count these places from 1.
PLACES = (
    Place("vase", -0.62, 0.42, 0.82, 20, 1.12, "green"),
    Place("teapot", -0.28, -0.62, 0.86, -25, 1.1, "white"),
    Place("obelisk", 0.12, 0.62, 0.6, 28, 1.15, "white"),
    Place("shield", -0.78, BACK - 0.01, 2.0, 0, 1.0),
    Place("hourglass", 0.44, -0.55, 0.8, 15, 1.1, "wood"),
    Place("mask", 1.0, BACK - 0.015, 1.98, 0, 1.05),
    Place("goblet", -0.88, -0.45, 0.92, 0, 1.15, "red"),
    Place("bell", 0.86, 0.36, 0.86, -22, 1.1, "green"),
    Place("flowerpot", 1.2, -0.42, 0.62, 0, 1.0, "white"),
    Place("drum", -1.62, 0.38, 0.6, 10, 1.1, "wood"),
)

STONES = {
    "white": [(0.3, "#b9b2a5"), (0.47, "#e6e1d6"), (0.5, "#8f8a84"), (0.53, "#e2dccf"), (0.75, "#cfc8bb")],
    "green": [(0.3, "#24382f"), (0.47, "#4a6455"), (0.5, "#c3cfc0"), (0.53, "#3f5a4a"), (0.75, "#6f8974")],
    "red": [(0.3, "#5a2a22"), (0.47, "#8f4a3b"), (0.5, "#dcc2ae"), (0.53, "#7f3f33"), (0.75, "#a8654f")],
}


WALKS = (
    Walk(17, 2.45, 82, 1.58, 1.12, 0.0),
    Walk(12, 2.0, 72, 1.25, 1.08, 0.15),
    Walk(9, 2.2, 70, 2.1, 0.98, 0.1),
    Walk(10, 1.75, 62, 1.62, 1.32, 0.45),
)


def build() -> None:
    """Build the room in an empty scene."""
    surfaces()
    for identity, place in enumerate(PLACES, start=1):
        exhibit(place, identity, BUILDERS)
        if place.stone:
            plinth(place, identity)
    light()


def plinth(place: Place, seed: int) -> None:
    """Build a pedestal with a foot, a cap and a label on its front."""
    if place.stone == "wood":
        stops = [(0.3, "#4d2f1a"), (0.5, "#8a5a33"), (0.58, "#5d3a20"), (0.75, "#a2703f")]
        stuff = mottled(f"Plinth {seed}", stops, 5, 0.5, distortion=0.8, stretch=(3, 3, 0.6), speckle=0.4)
    else:
        stuff = mottled(
            f"Plinth {seed}", STONES[place.stone], 4.5, 0.4, distortion=1.6, detail=5, speckle=0.2, bump=0.05
        )
    wide = 0.62 if place.name in ("bell", "drum") else 0.5 if place.name == "obelisk" else 0.44
    parts = [
        box("Plinth", (wide - 0.04, wide - 0.04, place.z - 0.12), (0, 0, (place.z - 0.12) / 2 + 0.07), stuff),
        box("Plinth foot", (wide + 0.02, wide + 0.02, 0.08), (0, 0, 0.04), stuff, 0.012),
        box("Plinth cap", (wide, wide, 0.05), (0, 0, place.z - 0.025), stuff, 0.01),
    ]
    y, z = -(wide - 0.04) / 2 - 0.004, place.z - 0.22
    corners = [(-0.08, y, z - 0.05), (0.08, y, z - 0.05), (0.08, y, z + 0.05), (-0.08, y, z + 0.05)]
    parts.append(quad("Label", corners, painted(f"Label {seed}", label(seed), 0.6, wear=0.1)))
    for part in parts:
        part.matrix_world = Matrix.Translation((place.x, place.y, 0)) @ part.matrix_basis


def surfaces() -> None:
    """Build the floor, three walls with a marble dado, and the pictures on them."""
    floor = painted("Parquet", pictures.parquet(3), 0.5, wear=0.35, wear_scale=3)
    quad(
        "Floor", [(-SIDE, FRONT, 0), (SIDE, FRONT, 0), (SIDE, BACK, 0), (-SIDE, BACK, 0)], floor, (2.0, 1.76)
    )
    plaster = mottled(
        "Plaster",
        [(0.28, "#6d7f80"), (0.45, "#93a19b"), (0.55, "#a7b1a6"), (0.75, "#c4c3b0")],
        2.2,
        0.9,
        detail=5,
        distortion=0.5,
        speckle=0.28,
        speckle_scale=45,
        bump=0.4,
    )
    dado = mottled(
        "Dado",
        [(0.3, "#3b2e28"), (0.47, "#6e5648"), (0.5, "#cdb9a2"), (0.53, "#5f493d"), (0.75, "#8d7460")],
        3.2,
        0.45,
        distortion=1.8,
        detail=5,
        speckle=0.25,
        bump=0.05,
    )
    rail = mottled("Rail", [(0.3, "#4a3018"), (0.7, "#7c5530")], 8, 0.5, stretch=(1, 1, 6), speckle=0.5)
    middle, depth = (BACK + FRONT) / 2, BACK - FRONT
    for name, size, centre in (
        ("Back wall", (2 * SIDE + 0.2, 0.1, HEIGHT), (0, BACK + 0.05, HEIGHT / 2)),
        ("Left wall", (0.1, depth, HEIGHT), (-SIDE - 0.05, middle, HEIGHT / 2)),
        ("Right wall", (0.1, depth, HEIGHT), (SIDE + 0.05, middle, HEIGHT / 2)),
    ):
        box(name, size, centre, plaster, 0)
        panel = tuple(s + 0.03 if s == 0.1 else s for s in size[:2])
        box("Dado", (*panel, 0.8), (*centre[:2], 0.4), dado)
        box(
            "Rail", (*(s + 0.07 if s == 0.1 else s for s in size[:2]), 0.06), (*centre[:2], 0.83), rail, 0.015
        )
    gilt = mottled(
        "Frame", [(0.3, "#5e421a"), (0.5, "#a67a30"), (0.7, "#cfa552")], 24, 0.5, 0.4, speckle=0.5, bump=0.5
    )
    green = ("#7d8c94", "#56705c", "#3a5030", "#58562c")
    dusk = ("#6b5a6e", "#5a4a4a", "#3f3a30", "#4d4a26")
    hill = ("#9aa0a8", "#8a7a58", "#8a6a34", "#5d6a2e")
    day, evening, pale = (
        ("#5b84ad", "#e8d3a8", "#f4ead8"),
        ("#3f4a70", "#e89a5a", "#f0c890"),
        ("#8fb0c0", "#efe6c8", "#fbf6ea"),
    )
    hang("Valley", "back", 0.12, 2.12, 0.98, 0.7, pictures.landscape(4, day, green), gilt)
    hang("Hanging", "back", -1.95, 1.85, 0.8, 1.14, pictures.tapestry(2), gilt)
    hang("Dusk", "back", 2.05, 1.95, 1.0, 0.74, pictures.landscape(12, evening, dusk), gilt)
    hang("Hills", "left", -0.1, 1.85, 1.15, 0.8, pictures.landscape(23, pale, hill), gilt)
    hang("Plain", "left", -1.75, 1.85, 0.9, 0.66, pictures.landscape(31, evening, green), gilt)
    hang("Carpet", "right", -0.1, 1.85, 0.82, 1.16, pictures.tapestry(8), gilt)
    hang("Lake", "right", -1.6, 1.85, 1.1, 0.78, pictures.landscape(44, day, hill), gilt)


def hang(
    name: str,
    wall: str,
    along: float,
    z: float,
    wide: float,
    tall: float,
    picture: np.ndarray,
    edges: bpy.types.Material,
) -> None:
    """Hang a framed picture; `along` is x on the back wall and y on the side walls."""
    canvas = upright(name, wide, tall, -0.02, painted(name, picture, 0.6, wear=0.2, wear_scale=30))
    location, degrees = {
        "back": ((along, BACK, z), 0),
        "left": ((-SIDE, along, z), 90),
        "right": ((SIDE, along, z), -90),
    }[wall]
    turned_to([canvas, *frame(wide, tall, 0.06, edges)], location, degrees)


def light() -> None:
    """Add daylight from above and from a tall window at the front left.

    The room has no ceiling and no front wall, which no photo shows, because open sky renders with much less noise than
    reflected light.
    """
    sky("#e4ecf5", SKY_STRENGTH)
    lamp("Window", (-2.6, -3.2, 3.3), (0, 0.3, 1.0), 1.5, 2.0, 250, "#ffe9cc")
    lamp("Skylight", (0.6, 0.0, 3.9), (0.2, 0.3, 1.0), 2.4, 1.2, 60, "#fff4e4")


SCENE = Scene("Museum room", build, PLACES, WALKS, centre=(0.0, 0.1), photos=48, samples=16)
