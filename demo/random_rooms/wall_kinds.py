# SPDX-License-Identifier: GPL-3.0-or-later
"""Exhibits on walls, seen from -Y: shield, painting, clock, plate, violin, sword."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
from studio.shapes import Shape, ball, box, lathe, quad, slab, smooth

from .stuffs import (
    Mottled,
    Painted,
    Plain,
    Rng,
    any_tone,
    cloth,
    darker,
    glaze,
    ink,
    metal,
    new_seed,
    pick,
    shades,
    uniform,
    wood,
)
from .things import Part, Thing, around, hanging, limb, parts_of, polar, rod


def shield(rng: Rng) -> Thing:
    """Draw a shield: round with a boss, or heater-shaped, painted or of metal."""
    emblem = Painted(
        pick(rng, ("sunburst", "checks", "stripes", "diamonds", "blobs")),
        ink(rng),
        new_seed(rng),
        (512, 512),
        0.45,
        uniform(rng, 0, 0.4),
    )
    edge = metal(rng)
    if rng.random() < 0.5:
        radius, boss, deep = uniform(rng, 0.24, 0.36), uniform(rng, 0.05, 0.09), uniform(rng, 0.04, 0.09)
        face = [
            (0.0005, deep + 0.05),
            (0.7 * boss, deep + 0.04),
            (boss, deep + 0.002),
            (0.6 * radius, 0.75 * deep),
            (radius, 0.02),
        ]
        rim = [(radius - 0.02, 0.025), (radius, 0.045), (radius + 0.015, 0.02), (radius + 0.005, 0.0)]
        parts = [Part(lathe(smooth(face, 5), 80, planar=True), emblem), Part(lathe(smooth(rim, 4), 80), edge)]
        parts += parts_of(
            edge,
            *(
                ball(0.011, 0.011, 0.009, 10).moved(*polar(radius - 0.035, a, 0.035))
                for a in around(int(rng.integers(8, 20)))
            ),
        )
        return hanging(Part(part.shape.turned("x", 90), part.stuff) for part in parts)
    half, tall = uniform(rng, 0.2, 0.27), uniform(rng, 0.55, 0.72)
    side = [
        (half, 0.5 * tall),
        (half, 0.15 * tall),
        (0.8 * half, -0.15 * tall),
        (0.42 * half, -0.38 * tall),
        (0.0, -0.5 * tall),
    ]
    right = smooth(side, 6)
    outline = np.vstack([right, (right * [-1, 1])[-2::-1]])
    plate = slab(outline, 0.03, 0.01)

    def bulge(at: np.ndarray) -> np.ndarray:
        moved = at.copy()
        moved[:, 1] -= 0.06 * (1 - (at[:, 0] / half) ** 2)
        return moved

    border = [
        (float(x), -0.02 - 0.06 * (1 - (float(x) / half) ** 2), float(z))
        for x, z in np.vstack([outline, outline[:1]])[::3]
    ]
    return hanging([Part(plate.bent(bulge), emblem), Part(limb(border, [0.013] * len(border), 8), edge)])


def painting(rng: Rng) -> Thing:
    """Draw a framed painting: landscape, portrait, flowers or an abstract one."""
    wide, tall = uniform(rng, 0.45, 0.95), uniform(rng, 0.45, 0.8)
    subject = pick(rng, ("landscape", "landscape", "portrait", "abstract", "floral"))
    if subject == "portrait":
        wide = 0.78 * tall
    size = (512, int(512 * wide / tall))
    canvas = Painted(subject, ink(rng), new_seed(rng), size, 0.55, wear=0.25, wear_scale=30)
    edge, gilt = uniform(rng, 0.04, 0.09), pick(rng, (wood, metal, glaze))(rng)
    parts = [Part(_upright(wide, tall, -0.025), canvas)]
    parts += parts_of(gilt, *frame(wide, tall, edge, uniform(rng, 0.03, 0.055)))
    return hanging(parts)


def frame(wide: float, tall: float, edge: float, deep: float) -> list[Shape]:
    """Return four bars around an opening in the plane y = 0, `edge` wide."""
    bars = []
    for side in (-1, 1):
        bars.append(box(wide + 2 * edge, deep, edge, 0.012).moved(y=-deep / 2, z=side * (tall + edge) / 2 - edge / 2))
        bars.append(box(edge, deep, tall, 0.012).moved(x=side * (wide + edge) / 2, y=-deep / 2, z=-tall / 2))
    return bars


def _upright(wide: float, tall: float, y: float) -> Shape:
    return quad(
        [(-wide / 2, y, -tall / 2), (wide / 2, y, -tall / 2), (wide / 2, y, tall / 2), (-wide / 2, y, tall / 2)]
    )


def clock(rng: Rng) -> Thing:
    """Draw a wall clock: round, or in a case with a pendulum."""
    radius = uniform(rng, 0.15, 0.24)
    colours = (pick(rng, ("#f0ead8", "#e6d6a8", "#dfe4e6", "#2a2c30")),)
    hands = "#e8dcb8" if colours[0] == "#2a2c30" else "#1c1814"
    face = Painted("dial", (*colours, hands, any_tone(rng)), new_seed(rng), (512, 512), 0.4, wear=0.1)
    rim = pick(rng, (metal, wood, glaze))(rng)
    shapes = [lathe([(radius, 0.05), (0.0005, 0.05)], 64, planar=True).turned("x", 90)]
    edge = smooth(
        [
            (1.14 * radius, 0.0),
            (1.2 * radius, 0.03),
            (1.1 * radius, 0.075),
            (1.0 * radius, 0.07),
            (0.99 * radius, 0.05),
        ],
        5,
    )
    # Looked at from -Y, the texture of a disc that was turned must not be mirrored.
    parts = [Part(shapes[0], face), Part(lathe(edge, 64).turned("x", 90), rim)]
    if rng.random() < 0.5:
        low = uniform(rng, 1.9, 2.6) * radius
        case = wood(rng)
        parts.append(Part(box(2.2 * radius, 0.03, low, 0.01).moved(y=-0.015, z=-low), case))
        gable = [(-1.25 * radius, 1.05 * radius), (1.25 * radius, 1.05 * radius), (0.0, 1.7 * radius)]
        parts.append(Part(slab(gable, 0.06, 0.01), case))
        swing = uniform(rng, -0.12, 0.12) * radius
        parts.append(Part(rod((0, -0.06, -radius), (swing, -0.06, -low + 0.25 * radius), 0.006), metal(rng)))
        bob = lathe([(0.0005, 0.012), (0.18 * radius, 0.008), (0.2 * radius, 0), (0.0005, -0.002)], 32).turned("x", 90)
        parts.append(Part(bob.moved(swing, -0.06, -low + 0.25 * radius), metal(rng)))
    return hanging(parts)


def plate(rng: Rng) -> Thing:
    """Draw a large painted plate with a raised rim."""
    radius, rim = uniform(rng, 0.19, 0.29), uniform(rng, 0.6, 0.75)
    profile = [
        (0.0005, 0.012),
        (0.9 * rim * radius, 0.014),
        (rim * radius, 0.03),
        (radius, 0.05),
        (radius + 0.004, 0.044),
        (rim * radius, 0.015),
        (0.5 * radius, 0.0),
    ]
    paint = Painted(
        pick(rng, ("sunburst", "sunburst", "floral", "blobs", "abstract")),
        ink(rng),
        new_seed(rng),
        (512, 512),
        0.3,
        wear=0.1,
    )
    return hanging([Part(lathe(smooth(profile, 5), 80, planar=True).turned("x", 90), paint)])


def violin(rng: Rng) -> Thing:
    """Draw a violin or a cello-like fiddle with strings."""
    scale = uniform(rng, 0.9, 1.45)
    varnish = Mottled(
        shades(rng, uniform(rng, 14, 30), 0.7, uniform(rng, 0.35, 0.6), 0.4), 7, 0.3, stretch=(9, 9, 0.8), speckle=0.3
    )
    ebony, string = Plain("#17120f", 0.4), Plain("#d8d4c8", 0.3, 0.6)
    waist = uniform(rng, 0.055, 0.07)
    half = smooth(
        [
            (0, 0),
            (0.07, 0.008),
            (0.105, 0.06),
            (0.098, 0.115),
            (waist, 0.17),
            (waist, 0.215),
            (0.085, 0.265),
            (0.075, 0.33),
            (0.03, 0.358),
            (0, 0.358),
        ],
        6,
    )
    outline = np.vstack([half, (half * [-1, 1])[-2:0:-1]])
    parts = [Part(slab(outline, 0.045, 0.004), varnish)]
    parts.append(Part(box(0.03, 0.02, 0.16, 0.005).moved(y=-0.04, z=0.34), varnish))
    parts.append(Part(box(0.034, 0.008, 0.26, 0.002).moved(y=-0.056, z=0.24), ebony))
    parts.append(Part(ball(0.024, 0.024, 0.026, 20).moved(0, -0.035, 0.54), varnish))
    parts.append(Part(box(0.034, 0.03, 0.06, 0.008).moved(y=-0.04, z=0.48), varnish))
    parts.append(
        Part(slab([(-0.02, 0.025), (0.02, 0.025), (0.012, 0.13), (-0.012, 0.13)], 0.008).moved(y=-0.055), ebony)
    )
    parts.append(Part(box(0.06, 0.008, 0.03, 0.002).moved(y=-0.058, z=0.17).moved(z=0.0), Plain("#d9b27a", 0.5)))
    for side in (-1, 1):
        hole = limb(
            [(side * 0.034, -0.046, 0.145), (side * 0.03, -0.046, 0.19), (side * 0.036, -0.046, 0.235)],
            [0.004, 0.003, 0.004],
            6,
        )
        parts += [
            Part(hole, ebony),
            *parts_of(ebony, *(rod((side * 0.015, -0.04, z), (side * 0.05, -0.04, z), 0.006) for z in (0.49, 0.515))),
        ]
    parts += parts_of(
        string,
        *(
            limb(
                [
                    ((k - 1.5) * 0.008, -0.066, 0.13),
                    ((k - 1.5) * 0.009, -0.088, 0.19),
                    ((k - 1.5) * 0.006, -0.066, 0.5),
                ],
                [0.0012] * 3,
                5,
            )
            for k in range(4)
        ),
    )
    return hanging(Part(part.shape.scaled(scale, scale, scale), part.stuff) for part in parts)


def sword(rng: Rng) -> Thing:
    """Draw a sword on a board, slanting, often with its scabbard."""
    long, wide = uniform(rng, 0.6, 0.85), uniform(rng, 0.018, 0.03)
    steel, hilt, grip = metal(rng), metal(rng), cloth(rng)
    slope, curve = uniform(rng, 15, 60), uniform(rng, 0, 0.08)
    blade = [(-wide, 0.0), (wide, 0.0), (wide, 0.75 * long), (0.0, 0.82 * long), (-wide, 0.75 * long)]

    def bend(at: np.ndarray) -> np.ndarray:
        moved = at.copy()
        moved[:, 0] += curve * (at[:, 2] / long) ** 2
        return moved

    parts = [Part(slab(blade, 0.014, 0.003).bent(bend), steel)]
    guard = uniform(rng, 0.08, 0.12)
    parts.append(
        Part(limb([(-guard, -0.007, 0.02), (0, -0.007, -0.01), (guard, -0.007, 0.02)], [0.012, 0.015, 0.012], 10), hilt)
    )
    parts.append(Part(rod((0, -0.007, 0), (0, -0.007, -0.16 * long), 0.016, 12), grip))
    parts.append(Part(ball(0.028, 0.022, 0.028, 20).moved(0, -0.007, -0.17 * long), hilt))
    parts = [Part(part.shape.moved(y=-0.035, z=-0.3 * long).turned("y", slope), part.stuff) for part in parts]
    board_wide, board_tall = 0.42 * long + 0.2, 0.5 * long
    ground = darker(wood(rng), 0.9) if rng.random() < 0.5 else glaze(rng)
    parts.append(Part(box(board_wide, 0.02, board_tall, 0.008).moved(y=-0.01, z=-board_tall / 2), ground))
    parts += parts_of(
        hilt,
        *(
            rod(
                (0.15 * s * sin(slope * pi / 180), 0, 0.15 * s * cos(slope * pi / 180)),
                (0.15 * s * sin(slope * pi / 180), -0.06, 0.15 * s * cos(slope * pi / 180)),
                0.008,
            )
            for s in (-1, 1)
        ),
    )
    return hanging(parts)
