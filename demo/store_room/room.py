# SPDX-License-Identifier: GPL-3.0-or-later
"""The store room: brick walls, a rack of boxes, furniture, light and places of the exhibits. World: Z up, metres."""

from __future__ import annotations

from math import cos, pi, sin

import bpy
import numpy as np
import pictures
from objects import BUILDERS, vitrine
from studio.materials import mottled, painted, wood
from studio.meshes import Point3, box, lathe, quad, tube
from studio.stage import Parts, Place, Scene, exhibit, lamp, sky, turned_to, upright
from studio.views import Walk

BACK, SIDE, FRONT, HEIGHT = 1.55, 2.8, -3.4, 3.4
TABLE, BENCH, STOOL, PLINTH, PALLET = 0.74, 0.34, 0.66, 0.86, 0.2
CASE = (0.98, 0.0)

# The instance ids in the masks count these places from 1.
PLACES = (
    Place("left pitcher", -0.5, 0.02, TABLE, 150, 1.0, kind="pitcher", prompt="pitcher"),
    Place("right pitcher", 0.56, -0.66, STOOL, 35, 1.0, kind="pitcher", prompt="pitcher"),
    Place("crate", -0.2, -0.72, BENCH, 12, 1.0),
    Place("bottle", -0.32, -0.74, BENCH + 0.15, 70, 1.0, prompt="wine bottle"),
    Place("ball", -0.06, -0.68, BENCH + 0.15, 40, 1.0, prompt="soccer ball"),
    Place("candelabrum", 0.3, 0.3, TABLE, -12, 1.0, prompt="candle"),
    Place("nautilus", *CASE, PLINTH, -25, 1.0),
    Place("guitar", -0.98, -0.56, 0.0, 14, 1.0, prompt="acoustic guitar"),
    Place("chest", -1.1, -0.02, PALLET, 14, 1.0),
    Place("mirror", 1.1, BACK - 0.09, 1.72, 0, 1.0),
    Place("clock", 0.28, BACK - 0.005, 1.98, 0, 1.0),
    Place("abacus", -0.1, 0.26, TABLE, 14, 1.0),
)


WALKS = (
    Walk(13, 2.4, 80, 1.6, 0.9, 0.0),
    Walk(9, 2.05, 72, 1.2, 0.86, 0.12),
    Walk(7, 2.15, 70, 2.1, 0.74, 0.1),
    Walk(7, 1.75, 60, 1.55, 1.0, 0.4),
)


def build() -> None:
    """Build the room in an empty scene."""
    surfaces()
    furniture()
    rack()
    clutter()
    for identity, place in enumerate(PLACES, start=1):
        exhibit(place, identity, BUILDERS)
    turned_to(vitrine(0.42, 0.42), (*CASE, PLINTH), -12)
    light()


def surfaces() -> None:
    """Build the floor and four walls, of which the mirror shows the front one."""
    floor = painted("Concrete", pictures.concrete(5), 0.75, wear=0.35, wear_scale=3)
    quad("Floor", [(-SIDE, FRONT, 0), (SIDE, FRONT, 0), (SIDE, BACK, 0), (-SIDE, BACK, 0)], floor, (1.4, 1.24))
    for name, (a, b), seed in (
        ("Back wall", ((-SIDE, BACK), (SIDE, BACK)), 1),
        ("Left wall", ((-SIDE, FRONT), (-SIDE, BACK)), 2),
        ("Right wall", ((SIDE, BACK), (SIDE, FRONT)), 3),
        ("Front wall", ((SIDE, FRONT), (-SIDE, FRONT)), 4),
    ):
        stuff = painted(name, pictures.bricks(seed), 0.9, wear=0.42, wear_scale=2.4, bump=0.5)
        long = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        quad(name, [(*a, 0), (*b, 0), (*b, HEIGHT), (*a, HEIGHT)], stuff, (long / 2.1, HEIGHT / 2.1))
    for k, (x, z) in enumerate(((2.05, 1.9), (-0.28, 2.28))):
        turned_to([upright(f"Poster {k}", 0.62, 0.88, -0.01, paper(k))], (x, BACK, z), 0)
    for k, (y, side) in enumerate(((0.3, -1), (-1.1, -1), (0.2, 1), (-1.2, 1))):
        turned_to([upright(f"Side poster {k}", 0.7, 1.0, -0.01, paper(k + 2))], (side * SIDE, y, 1.75), -90 * side)


def paper(seed: int) -> bpy.types.Material:
    """Return the material of a poster."""
    return painted(f"Poster {seed}", pictures.poster(seed), 0.7, wear=0.35, wear_scale=20)


def furniture() -> None:
    """Build the table, the bench under the crate, the stool, the plinth under the case, and the pallet."""
    oak = wood("Table wood", "#5a3a1e", "#a3713c")
    pine = wood("Bench wood", "#7c5a34", "#b58a52")
    paint = mottled("Paint", [(0.3, "#2f4a44"), (0.5, "#47695f"), (0.58, "#7d8468"), (0.75, "#3c5a52")], 7, 0.6)
    parts = [box("Table top", (1.5, 0.72, 0.045), (0, 0.2, TABLE - 0.0225), oak, 0.008)]
    parts.append(box("Table apron", (1.34, 0.56, 0.09), (0, 0.2, TABLE - 0.09), oak, 0.006))
    for x in (-0.66, 0.66):
        for y in (-0.08, 0.48):
            parts.append(box("Table leg", (0.07, 0.07, TABLE - 0.05), (x, y, (TABLE - 0.05) / 2), oak, 0.01))
    bench = [box("Bench top", (0.74, 0.46, 0.04), (0, 0, BENCH - 0.02), pine, 0.006)]
    bench += [
        box("Bench end", (0.04, 0.4, BENCH - 0.04), (s * 0.31, 0, BENCH / 2 - 0.02), pine, 0.006) for s in (-1, 1)
    ]
    turned_to(bench, (-0.2, -0.72, 0), 12)
    legs: Parts = [lathe("Stool seat", [(0.0005, 0.0), (0.17, 0.0), (0.175, 0.015), (0.17, 0.03), (0.0005, 0.03)], oak)]
    legs[0].location.z = STOOL - 0.03
    for k in range(3):
        a = 2 * pi * k / 3 + 0.4
        foot, head = (0.21 * cos(a), 0.21 * sin(a), 0.0), (0.1 * cos(a), 0.1 * sin(a), STOOL - 0.03)
        half = tuple((p + q) / 2 for p, q in zip(foot, head, strict=True))
        legs.append(tube("Stool leg", [foot, half, head], 0.014, oak, 12))
    ring = [(0.15 * cos(a), 0.15 * sin(a), 0.28) for a in np.linspace(0, 2 * pi, 40)]
    legs.append(tube("Stool ring", ring, 0.009, oak, 8))
    turned_to(legs, (0.56, -0.66, 0), 0)
    plinth = [
        box("Plinth", (0.48, 0.48, PLINTH - 0.06), (0, 0, (PLINTH - 0.06) / 2), paint),
        box("Plinth cap", (0.52, 0.52, 0.06), (0, 0, PLINTH - 0.03), oak, 0.012),
    ]
    turned_to(plinth, (*CASE, 0), -12)
    pallet = [
        box("Pallet board", (0.13, 0.62, 0.025), (x, 0, PALLET - 0.0125), pine, 0.004)
        for x in np.linspace(-0.4, 0.4, 6)
    ]
    pallet += [
        box("Pallet beam", (0.93, 0.08, PALLET - 0.03), (0, y, (PALLET - 0.03) / 2), pine) for y in (-0.25, 0, 0.25)
    ]
    turned_to(pallet, (-1.1, -0.02, 0), 14)


def cardboard(seed: int, size: Point3, where: Point3, turn: float) -> None:
    """Build a cardboard box with printed sides that depend on `seed`."""
    x, y, z = size
    top = painted(f"Lid {seed}", pictures.carton(seed + 500), 0.9, wear=0.3)
    parts = [box("Carton", (x - 0.01, y - 0.01, z), (0, 0, z / 2), top, 0)]
    for k, (wide, deep, around) in enumerate(((x, y, 0), (y, x, 90), (y, x, -90))):
        side = upright(
            f"Carton side {seed}",
            wide,
            z,
            -deep / 2,
            painted(f"Carton {seed} {k}", pictures.carton(3 * seed + k), 0.9, wear=0.3),
        )
        turned_to([side], (0, 0, z / 2), around)
        parts.append(side)
    turned_to(parts, where, turn)


def rack() -> None:
    """Build a steel rack along the back wall with boxes on its shelves."""
    steel = mottled("Steel", [(0.3, "#3a4650"), (0.5, "#5c6c78"), (0.6, "#8a6a4a"), (0.75, "#4f5c66")], 9, 0.5, 0.3)
    left, right, near, far = -2.3, -0.62, BACK - 0.48, BACK - 0.06
    for x in (left, right):
        for y in (near, far):
            box("Rack post", (0.04, 0.04, 2.25), (x, y, 1.125), steel, 0.004)
    seed = 20
    for level in (0.12, 0.76, 1.38, 2.0):
        size = (right - left + 0.04, far - near + 0.04, 0.03)
        box("Rack shelf", size, ((left + right) / 2, (near + far) / 2, level), steel, 0.004)
        rng = np.random.default_rng(seed)
        x = left + 0.06
        while x < right - 0.22:
            wide, tall = float(rng.uniform(0.24, 0.42)), float(rng.uniform(0.22, 0.5))
            wide = min(wide, right - 0.04 - x)
            place = (x + wide / 2, (near + far) / 2 + float(rng.uniform(-0.05, 0.03)), level + 0.015)
            cardboard(seed, (wide - 0.03, 0.34, tall), place, float(rng.uniform(-5, 5)))
            x, seed = x + wide, seed + 1


def clutter() -> None:
    """Build boxes on the floor and rolled canvases in a corner."""
    for seed, size, where, turn in (
        (60, (0.6, 0.5, 0.5), (1.55, 0.98, 0.0), -12),
        (61, (0.5, 0.42, 0.4), (1.6, 1.0, 0.5), 9),
        (62, (0.56, 0.46, 0.44), (2.25, 0.72, 0.0), -38),
        (63, (0.4, 0.36, 0.3), (2.22, 0.74, 0.44), -20),
        (64, (0.62, 0.5, 0.42), (-2.2, 0.45, 0.0), 32),
        (65, (0.4, 0.4, 0.34), (-2.2, 0.48, 0.42), 12),
        (66, (0.5, 0.4, 0.36), (0.2, 1.12, 0.0), 6),
    ):
        cardboard(seed, size, where, turn)
    cloth = mottled("Canvas", [(0.3, "#a3957a"), (0.6, "#d8ccb0")], 25, 0.9, speckle=0.4)
    blue = mottled("Blue cloth", [(0.3, "#26406a"), (0.6, "#4a6a98")], 25, 0.9, speckle=0.4)
    for k, (x, y) in enumerate(((0.62, BACK - 0.16), (0.78, BACK - 0.14), (0.7, BACK - 0.3))):
        top = (x + 0.05 * sin(k * 2.0), y + 0.06, 1.05 + 0.14 * k)
        middle = tuple((p + q) / 2 for p, q in zip((x, y, 0.0), top, strict=True))
        tube("Roll", [(x, y, 0.0), middle, top], 0.05 + 0.012 * k, (cloth, blue)[k % 2], 24)


def light() -> None:
    """Add light from above, where the missing ceiling is not in any photo, and from a lamp on the left."""
    sky("#e8ecf2", 0.8)
    lamp("Work lamp", (-2.3, -2.9, 3.0), (0, 0.2, 0.9), 1.5, 1.6, 230, "#ffe6c4")
    lamp("Strip light", (0.7, -0.1, 3.6), (0.3, 0.2, 0.9), 2.2, 0.9, 70, "#f2f6ff")


SCENE = Scene("Store room", build, PLACES, WALKS, centre=(0.0, 0.0), photos=36, samples=8)
