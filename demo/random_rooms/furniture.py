# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture, which is labelled "ignore": plinths, tables, shelves, benches, platforms, glass cases, wall hangings."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sin

import numpy as np
from studio.shapes import box, loft, quad

from .stuffs import Glass, Mottled, Painted, Rng, cloth, ink, metal, new_seed, paint, pick, stone, uniform, wood
from .things import Part, Thing, hanging, parts_of, rod, standing


@dataclass(frozen=True)
class Surface:
    """A level rectangle to put things on: middle and half sizes in the plane, height, and free height above."""

    x: float
    y: float
    half_x: float
    half_y: float
    z: float
    free: float = 9.0


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of furniture.

    Attributes
    ----------
    name
        Name, and the word for it.
    thing
        Its shapes.
    surfaces
        Where things can be put, in its own coordinates.
    """

    name: str
    thing: Thing
    surfaces: tuple[Surface, ...] = ()


def plinth(rng: Rng, wide: float, deep: float, tall: float) -> Piece:
    """Draw a plinth of this size: plain, with foot and cap, or with a label."""
    stuff = pick(rng, (stone, stone, wood, paint))(rng)
    parts = []
    style = int(rng.integers(3))
    if style == 0:
        parts.append(Part(box(wide, deep, tall), stuff))
    else:
        parts.append(Part(box(wide - 0.04, deep - 0.04, tall - 0.12).moved(z=0.07), stuff))
        parts.append(Part(box(wide, deep, 0.08, 0.012), stuff))
        parts.append(Part(box(wide, deep, 0.05, 0.01).moved(z=tall - 0.05), stuff))
    if style != 1 and tall > 0.45:
        label = Painted("pages", ("#efe9da", "#3a342c", "#8a7a55", "#cfc4aa"), new_seed(rng), (160, 256), 0.6, wear=0.1)
        y, z = -deep / 2 - 0.003 + 0.02 * (style != 0), tall - 0.2
        parts.append(
            Part(quad([(-0.08, y, z - 0.05), (0.08, y, z - 0.05), (0.08, y, z + 0.05), (-0.08, y, z + 0.05)]), label)
        )
    thing = standing(parts)
    return Piece("plinth", thing, (Surface(0, 0, wide / 2, deep / 2, tall),))


def table(rng: Rng) -> Piece:
    """Draw a table with four legs, or with two panels."""
    wide, deep, tall = uniform(rng, 0.9, 1.5), uniform(rng, 0.5, 0.7), uniform(rng, 0.6, 0.78)
    timber = wood(rng)
    parts = [Part(box(wide, deep, 0.045, 0.008).moved(z=tall - 0.045), timber)]
    parts.append(Part(box(wide - 0.12, deep - 0.12, 0.08).moved(z=tall - 0.125), timber))
    panels = rng.random() < 0.3
    for x in (-1, 1):
        if panels:
            parts.append(Part(box(0.05, deep - 0.1, tall - 0.04).moved(x=x * (wide / 2 - 0.1)), timber))
        else:
            parts += [
                Part(box(0.06, 0.06, tall - 0.04).moved(x * (wide / 2 - 0.09), y * (deep / 2 - 0.09)), timber)
                for y in (-1, 1)
            ]
    return Piece("table", standing(parts), (Surface(0, 0, wide / 2 - 0.02, deep / 2 - 0.02, tall),))


def bench(rng: Rng) -> Piece:
    """Draw a low bench."""
    wide, deep, tall = uniform(rng, 0.7, 1.2), uniform(rng, 0.38, 0.48), uniform(rng, 0.32, 0.46)
    timber = wood(rng)
    parts = [Part(box(wide, deep, 0.045).moved(z=tall - 0.045), timber)]
    parts += [Part(box(0.05, deep - 0.06, tall - 0.04).moved(x=s * (wide / 2 - 0.12)), timber) for s in (-1, 1)]
    return Piece("bench", standing(parts), (Surface(0, 0, wide / 2 - 0.01, deep / 2 - 0.01, tall),))


def platform(rng: Rng) -> Piece:
    """Draw a low platform, in one or two steps."""
    wide, deep, tall = uniform(rng, 0.8, 1.3), uniform(rng, 0.6, 0.9), uniform(rng, 0.12, 0.25)
    stuff = pick(rng, (stone, wood, paint))(rng)
    parts = [Part(box(wide, deep, tall), stuff)]
    return Piece("platform", standing(parts), (Surface(0, 0, wide / 2 - 0.01, deep / 2 - 0.01, tall),))


def shelves(rng: Rng) -> Piece:
    """Draw an open shelf unit for a wall, with two or three boards."""
    wide, deep = uniform(rng, 0.9, 1.5), uniform(rng, 0.4, 0.5)
    timber, back = wood(rng), paint(rng)
    boards = int(rng.integers(2, 4))
    step = uniform(rng, 0.52, 0.62)
    low = uniform(rng, 0.3, 0.5)
    tall = low + boards * step
    parts = [Part(box(0.035, deep, tall).moved(x=s * (wide / 2 - 0.0175)), timber) for s in (-1, 1)]
    parts.append(Part(box(wide - 0.07, 0.015, tall - 0.02, 0).moved(y=deep / 2 - 0.01), back))
    surfaces = []
    for level in range(boards + 1):
        z = low + level * step
        parts.append(Part(box(wide - 0.06, deep - 0.02, 0.03, 0.003).moved(z=z - 0.03), timber))
        free = step - 0.05 if level < boards else 9.0
        if z < 1.5:
            surfaces.append(Surface(0, -0.01, wide / 2 - 0.06, deep / 2 - 0.03, z, free))
    return Piece("shelf", standing(parts), tuple(surfaces))


def wall_shelf(rng: Rng) -> Piece:
    """Draw a board on brackets. Its box is around the middle of the wall's plane; the surface is below it."""
    wide, deep = uniform(rng, 0.5, 1.1), uniform(rng, 0.3, 0.42)
    timber = pick(rng, (wood, paint))(rng)
    parts = [Part(box(wide, deep, 0.035, 0.005).moved(y=-deep / 2), timber)]
    for side in (-1, 1):
        parts.append(Part(rod((side * 0.4 * wide, -0.02, -0.16), (side * 0.4 * wide, -0.8 * deep, 0.0), 0.012), timber))
        parts.append(Part(box(0.03, 0.02, 0.2, 0.003).moved(side * 0.4 * wide, -0.01, -0.19), timber))
    thing = hanging(parts)
    top = thing.high[2]
    return Piece("wall shelf", thing, (Surface(0, -deep / 2, wide / 2 - 0.01, deep / 2 - 0.01, top),))


def cabinet(rng: Rng) -> Piece:
    """Draw a cabinet with doors or drawers."""
    wide, deep, tall = uniform(rng, 0.6, 1.0), uniform(rng, 0.4, 0.5), uniform(rng, 0.7, 1.0)
    timber, knobs = pick(rng, (wood, wood, paint))(rng), metal(rng)
    panel = pick(rng, (wood, paint))(rng)
    parts = [
        Part(box(wide, deep, tall - 0.03).moved(z=0.0), timber),
        Part(box(wide + 0.04, deep, 0.03).moved(z=tall - 0.03), timber),
    ]
    columns, rows = int(rng.integers(1, 3)), int(rng.integers(1, 4))
    for i in range(columns):
        for j in range(rows):
            w, h = (wide - 0.06) / columns, (tall - 0.12) / rows
            x, z = -wide / 2 + 0.03 + (i + 0.5) * w, 0.05 + j * h
            parts.append(Part(box(w - 0.02, 0.016, h - 0.02, 0.004).moved(x, -deep / 2 - 0.006, z), panel))
            parts.append(Part(rod((x, -deep / 2, z + h / 2), (x, -deep / 2 - 0.035, z + h / 2), 0.014), knobs))
    return Piece("cabinet", standing(parts), (Surface(0, 0.02, wide / 2, deep / 2 - 0.03, tall),))


def glass_case(rng: Rng, wide: float, deep: float, tall: float) -> Piece:
    """Draw a case of glass panes with a thin frame. The panes are not in the masks."""
    edge, glass = metal(rng), Glass("#cfe0dc", 0.03, hidden=True)
    parts = []
    for side in (-1, 1):
        parts += parts_of(
            glass,
            box(wide, 0.004, tall, 0).moved(y=side * deep / 2),
            box(0.004, deep, tall, 0).moved(x=side * wide / 2),
        )
        for z in (0.0, tall - 0.012):
            parts.append(Part(box(wide + 0.012, 0.012, 0.012, 0).moved(y=side * deep / 2, z=z), edge))
            parts.append(Part(box(0.012, deep + 0.012, 0.012, 0).moved(x=side * wide / 2, z=z), edge))
        parts += [Part(box(0.012, 0.012, tall, 0).moved(side * wide / 2, s * deep / 2), edge) for s in (-1, 1)]
    parts.append(Part(box(wide, deep, 0.004, 0).moved(z=tall - 0.004), glass))
    return Piece("glass case", standing(parts))


def curtain(rng: Rng) -> Piece:
    """Draw a curtain in folds below a rail."""
    wide, tall, folds = uniform(rng, 0.5, 1.0), uniform(rng, 1.8, 2.4), int(rng.integers(5, 10))
    x = np.linspace(-wide / 2, wide / 2, 8 * folds + 1)
    rows = []
    for t in np.linspace(0, 1, 7).tolist():
        y = -0.05 - 0.035 * np.sin(2 * pi * folds * x / wide + 0.4 * sin(3 * t)) * (0.5 + 0.5 * t)
        front = np.stack([x * (1 - 0.06 * sin(pi * t)), y, np.full_like(x, (1 - t) * tall)], axis=1)
        rows.append(np.concatenate([front, front[::-1] + [0, 0.006, 0]]))
    fabric = (
        cloth(rng)
        if rng.random() < 0.5
        else Painted(pick(rng, ("stripes", "diamonds", "floral")), ink(rng), new_seed(rng), (512, 512), 0.9)
    )
    rail = rod((-wide / 2 - 0.08, -0.05, tall), (wide / 2 + 0.08, -0.05, tall), 0.015)
    return Piece("curtain", hanging([Part(loft(rows), fabric), Part(rail, metal(rng))]))


def banner(rng: Rng) -> Piece:
    """Draw a banner or a tapestry."""
    wide, tall = uniform(rng, 0.5, 1.0), uniform(rng, 0.8, 1.4)
    weave = Painted(
        pick(rng, ("carpet", "diamonds", "bands", "checks")), ink(rng), new_seed(rng), (512, 512), 0.9, wear=0.35
    )
    sheet = quad([(-wide / 2, -0.03, 0), (wide / 2, -0.03, 0), (wide / 2, -0.03, tall), (-wide / 2, -0.03, tall)])
    rail = rod((-wide / 2 - 0.04, -0.025, tall), (wide / 2 + 0.04, -0.025, tall), 0.018)
    return Piece(
        "banner",
        hanging(
            [Part(sheet, weave), Part(rail, wood(rng)), Part(box(0.02, 0.02, 0.02).moved(y=-0.01, z=tall), wood(rng))]
        ),
    )


def panel(rng: Rng) -> Piece:
    """Draw an information panel."""
    wide, tall = uniform(rng, 0.5, 0.8), uniform(rng, 0.7, 1.1)
    colours = ("#e9e6dc", "#2c2a26", *ink(rng)[2:])
    sheet = quad([(-wide / 2, -0.025, 0), (wide / 2, -0.025, 0), (wide / 2, -0.025, tall), (-wide / 2, -0.025, tall)])
    poster = Painted("poster", colours, new_seed(rng), (512, 384), 0.6, wear=0.2)
    board = box(wide + 0.02, 0.02, tall + 0.02, 0.003).moved(y=-0.01, z=-0.01)
    return Piece("information panel", hanging([Part(sheet, poster), Part(board, paint(rng))]))


def rug(rng: Rng) -> Piece:
    """Draw a rug on the floor."""
    wide, deep = uniform(rng, 1.6, 2.6), uniform(rng, 1.2, 1.8)
    weave = Painted("carpet", ink(rng), new_seed(rng), (768, 768), 0.95, wear=0.35)
    edge = Mottled(((0.3, "#4a4038"), (0.7, "#6a5e50")), 30, 0.9)
    top = quad(
        [
            (-wide / 2, -deep / 2, 0.008),
            (wide / 2, -deep / 2, 0.008),
            (wide / 2, deep / 2, 0.008),
            (-wide / 2, deep / 2, 0.008),
        ]
    )
    return Piece("rug", standing([Part(box(wide, deep, 0.007, 0), edge), Part(top, weave)]))
