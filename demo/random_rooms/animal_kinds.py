# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures of animals and toys: teddy bear, totem pole, elephant, bird, chess piece."""

from __future__ import annotations

from studio.shapes import ball, box, lathe, smooth

from .round_kinds import bird
from .stuffs import (
    Mottled,
    Painted,
    Plain,
    Rng,
    any_tone,
    clay,
    cloth,
    glaze,
    ink,
    metal,
    new_seed,
    pick,
    shades,
    stone,
    uniform,
    wood,
)
from .things import Part, Thing, hoop, limb, parts_of, standing


def teddy(rng: Rng) -> Thing:
    """Draw a sitting teddy bear."""
    unit = uniform(rng, 0.085, 0.125)
    fur, sole = cloth(rng), cloth(rng)
    if rng.random() < 0.6:
        brown = shades(rng, uniform(rng, 22, 36), 0.5, uniform(rng, 0.4, 0.7))
        fur = Mottled(brown, 30, 0.95, speckle=0.5, speckle_scale=200, bump=0.6)
    fat, head_size = uniform(rng, 0.9, 1.15), uniform(rng, 0.8, 0.95)
    shapes = [ball(fat * unit, 0.85 * unit, 1.1 * unit, 36).moved(z=1.0 * unit)]
    top = 2.0 * unit + 0.6 * head_size * unit
    shapes.append(ball(head_size * unit, 0.85 * head_size * unit, 0.85 * head_size * unit, 36).moved(z=top))
    shapes += [
        ball(0.32 * unit, 0.16 * unit, 0.32 * unit, 20).moved(s * 0.66 * unit, 0, top + 0.68 * unit) for s in (-1, 1)
    ]
    wave = uniform(rng, -0.5, 0.9)
    for side, lift in ((-1, -0.3), (1, wave)):
        shapes.append(
            limb(
                [
                    (side * 0.75 * unit, 0, 1.7 * unit),
                    (side * 1.25 * unit, -0.3 * unit, (1.55 + 0.5 * lift) * unit),
                    (side * 1.4 * unit, -0.6 * unit, (1.4 + lift) * unit),
                ],
                [0.34 * unit, 0.34 * unit, 0.3 * unit],
            )
        )
        shapes.append(
            ball(0.32 * unit, 0.32 * unit, 0.32 * unit, 20).moved(side * 1.4 * unit, -0.6 * unit, (1.4 + lift) * unit)
        )
        shapes.append(
            limb(
                [
                    (side * 0.5 * unit, -0.2 * unit, 0.45 * unit),
                    (side * 0.75 * unit, -0.9 * unit, 0.4 * unit),
                    (side * 0.85 * unit, -1.4 * unit, 0.42 * unit),
                ],
                [0.42 * unit, 0.4 * unit, 0.36 * unit],
            )
        )
    parts = parts_of(fur, *shapes)
    for side in (-1, 1):
        parts.append(
            Part(
                ball(0.36 * unit, 0.1 * unit, 0.42 * unit, 20).moved(side * 0.86 * unit, -1.45 * unit, 0.42 * unit),
                sole,
            )
        )
        parts.append(
            Part(
                ball(0.08 * unit, 0.06 * unit, 0.08 * unit, 12).moved(
                    side * 0.3 * unit, -0.72 * head_size * unit, top + 0.2 * unit
                ),
                Plain("#15110e", 0.2),
            )
        )
    parts.append(Part(ball(0.36 * unit, 0.3 * unit, 0.28 * unit, 20).moved(0, -0.7 * unit, top - 0.18 * unit), sole))
    parts.append(
        Part(
            ball(0.12 * unit, 0.08 * unit, 0.09 * unit, 12).moved(0, -0.98 * unit, top - 0.1 * unit),
            Plain("#1c1512", 0.4),
        )
    )
    bow = Plain(any_tone(rng, (0.5, 0.9), (0.5, 0.9)), 0.6)
    parts += parts_of(
        bow,
        *(
            ball(0.26 * unit, 0.1 * unit, 0.16 * unit, 16).moved(s * 0.24 * unit, -0.72 * unit, 1.95 * unit)
            for s in (-1, 1)
        ),
    )
    return standing(parts)


def totem(rng: Rng) -> Thing:
    """Draw a totem pole: painted faces with beaks, wings and ears above each other."""
    wide, levels = uniform(rng, 0.1, 0.14), int(rng.integers(3, 5))
    timber = wood(rng)
    paints = [Plain(any_tone(rng, (0.35, 0.85), (0.5, 0.9)), 0.6) for _ in range(4)]
    dark, white, winged = Plain("#1a1512", 0.6), Plain("#e6ddc8", 0.6), int(rng.integers(2))
    parts = [Part(box(3.2 * wide, 2.8 * wide, 0.06), timber)]
    z = 0.06
    for level in range(levels):
        tall = uniform(rng, 0.2, 0.28)
        points = [(0.92 * wide, 0), (wide, 0.1 * tall), (1.04 * wide, 0.6 * tall), (0.94 * wide, tall)]
        parts.append(Part(lathe(smooth(points, 5), 40).moved(z=z), timber))
        paint = paints[level % 4]
        parts.append(Part(hoop(0.97 * wide, z + tall, 0.014), paint))
        for side in (-1, 1):
            x, y, eye = side * 0.42 * wide, -0.86 * wide, z + 0.66 * tall
            parts.append(Part(ball(0.34 * wide, 0.2 * wide, 0.26 * wide, 20).moved(x, y, eye), white))
            parts.append(Part(ball(0.14 * wide, 0.12 * wide, 0.16 * wide, 14).moved(x, y - 0.14 * wide, eye), dark))
            parts.append(
                Part(
                    limb(
                        [
                            (0.1 * x, y - 0.06, eye + 0.3 * wide),
                            (x, y - 0.02, eye + 0.4 * wide),
                            (2 * x, y * 0.7, eye + 0.2 * wide),
                        ],
                        [0.014, 0.02, 0.008],
                        10,
                    ),
                    paint,
                )
            )
            if level % 2 == winged:
                wing = [
                    (side * 0.8 * wide, 0, z + 0.4 * tall),
                    (side * 2.0 * wide, 0.02, z + 0.65 * tall),
                    (side * 2.8 * wide, 0.0, z + 0.4 * tall),
                ]
                parts.append(Part(limb(wing, [0.3 * wide, 0.36 * wide, 0.1 * wide], 12, 0.3), paints[(level + 1) % 4]))
        if rng.random() < 0.5:
            beak = [
                (0, -0.9 * wide, z + 0.45 * tall),
                (0, -1.7 * wide, z + 0.42 * tall),
                (0, -2.0 * wide, z + 0.22 * tall),
            ]
            parts.append(Part(limb(beak, [0.32 * wide, 0.24 * wide, 0.05 * wide], 14), paint))
        else:
            parts.append(
                Part(ball(0.2 * wide, 0.24 * wide, 0.18 * wide, 16).moved(0, -1.02 * wide, z + 0.42 * tall), paint)
            )
            parts.append(
                Part(
                    ball(0.6 * wide, 0.16 * wide, 0.13 * wide, 24).moved(0, -0.92 * wide, z + 0.2 * tall),
                    paints[(level + 2) % 4],
                )
            )
            parts.append(
                Part(ball(0.5 * wide, 0.12 * wide, 0.06 * wide, 24).moved(0, -1.0 * wide, z + 0.2 * tall), dark)
            )
        z += tall
    parts.append(Part(lathe([(0.9 * wide, z), (0.6 * wide, z + 0.5 * wide), (0.0005, z + 0.7 * wide)], 32), paints[0]))
    return standing(parts)


def elephant(rng: Rng) -> Thing:
    """Draw an elephant figure with trunk, tusks and perhaps a saddle cloth."""
    unit = uniform(rng, 0.075, 0.11)
    body = pick(rng, (stone, wood, metal, clay, glaze))(rng)
    ivory = Plain("#ece3cc", 0.4)
    shapes = [ball(1.9 * unit, 1.15 * unit, 1.25 * unit, 40).moved(z=2.6 * unit)]
    for x, y in ((-1.1, -0.6), (-1.1, 0.6), (1.1, -0.6), (1.1, 0.6)):
        lead = uniform(rng, -0.35, 0.35) * unit
        shapes.append(
            limb(
                [
                    (x * unit, y * unit, 2.3 * unit),
                    (x * unit + 0.5 * lead, y * unit, 1.1 * unit),
                    (x * unit + lead, y * unit, 0.0),
                ],
                [0.62 * unit, 0.45 * unit, 0.5 * unit],
            )
        )
    shapes.append(ball(0.95 * unit, 0.85 * unit, 1.0 * unit, 32).moved(2.1 * unit, 0, 3.2 * unit))
    lift = uniform(rng, -1.6, 1.8)
    trunk = [
        (2.7 * unit, 0, 3.1 * unit),
        (3.4 * unit, 0, 2.5 * unit),
        (3.7 * unit, 0, (1.9 + 0.4 * lift) * unit),
        (4.1 * unit, 0, (1.9 + lift) * unit),
    ]
    shapes.append(limb(trunk, [0.5 * unit, 0.36 * unit, 0.26 * unit, 0.17 * unit]))
    ear = uniform(rng, 0.8, 1.25)
    for side in (-1, 1):
        flap = ball(0.16 * unit, 0.75 * ear * unit, 0.95 * ear * unit, 24).turned("z", side * 50 - 90 + 90 * (side < 0))
        shapes.append(flap.moved(1.6 * unit, side * 1.1 * unit, 3.2 * unit))
    shapes.append(
        limb(
            [(-1.8 * unit, 0, 3.0 * unit), (-2.2 * unit, 0, 2.4 * unit), (-2.2 * unit, 0, 1.5 * unit)],
            [0.12 * unit, 0.09 * unit, 0.12 * unit],
            8,
        )
    )
    parts = parts_of(body, *shapes)
    for side in (-1, 1):
        tusk = [
            (2.7 * unit, side * 0.5 * unit, 2.8 * unit),
            (3.3 * unit, side * 0.6 * unit, 2.3 * unit),
            (3.9 * unit, side * 0.5 * unit, 2.6 * unit),
        ]
        parts.append(Part(limb(tusk, [0.15 * unit, 0.13 * unit, 0.03 * unit], 10), ivory))
        parts.append(
            Part(
                ball(0.1 * unit, 0.08 * unit, 0.1 * unit, 10).moved(2.75 * unit, side * 0.62 * unit, 3.45 * unit),
                Plain("#140f0c", 0.3),
            )
        )
    if rng.random() < 0.6:
        saddle = ball(1.0 * unit, 1.24 * unit, 1.34 * unit, 40).moved(z=2.62 * unit)
        rug = Painted(pick(rng, ("diamonds", "stripes", "checks")), ink(rng), new_seed(rng), (256, 256), 0.85)
        parts.append(Part(saddle, rug))
    if rng.random() < 0.7:
        parts.append(Part(box(5.0 * unit, 2.8 * unit, 0.03).moved(z=-0.028), pick(rng, (wood, stone))(rng)))
    return standing(parts)


def stuffed_bird(rng: Rng) -> Thing:
    """Draw a carved bird on a branch that rises from a disc."""
    long, tall = uniform(rng, 0.09, 0.14), uniform(rng, 0.14, 0.26)
    bark = wood(rng)
    parts = [Part(lathe([(0.0005, 0), (0.11, 0), (0.105, 0.025), (0.0005, 0.025)], 40), bark)]
    parts.append(
        Part(
            limb(
                [(0, 0, 0.02), (0.03, 0.01, 0.5 * tall), (0, 0, tall), (0.09, 0.0, tall + 0.05)],
                [0.024, 0.018, 0.016, 0.008],
                10,
            ),
            bark,
        )
    )
    parts.append(
        Part(
            limb([(0, 0, 0.8 * tall), (-0.07, 0.02, 0.95 * tall), (-0.13, 0.0, 1.05 * tall)], [0.012, 0.01, 0.006], 8),
            bark,
        )
    )
    shapes = [shape.turned("z", uniform(rng, -10, 10)) for shape in bird(long, (0.0, 0.0, tall + 0.66 * long))]
    body, beak = pick(rng, (glaze, wood))(rng), Plain(any_tone(rng, (0.5, 0.9), (0.6, 0.9)), 0.4)
    parts += [Part(shape, beak if k in (2, 4, 5) else body) for k, shape in enumerate(shapes)]
    wings = [
        ball(0.75 * long, 0.12 * long, 0.36 * long, 20)
        .turned("y", 25)
        .moved(-0.15 * long, s * 0.5 * long, tall + 0.7 * long)
        for s in (-1, 1)
    ]
    parts += parts_of(glaze(rng), *wings)
    for side in (-1, 1):
        parts.append(
            Part(
                ball(0.06 * long, 0.04 * long, 0.06 * long, 10).moved(
                    0.95 * long, side * 0.28 * long, tall + 1.32 * long
                ),
                Plain("#0f0c0a", 0.2),
            )
        )
    return standing(parts)


def chess_piece(rng: Rng) -> Thing:
    """Draw a large chess piece: king, bishop or rook."""
    wide, tall = uniform(rng, 0.1, 0.14), uniform(rng, 0.36, 0.52)
    stuff = pick(rng, (wood, stone, glaze))(rng)
    points = [
        (0.0005, 0),
        (wide, 0),
        (wide, 0.05 * tall),
        (0.75 * wide, 0.12 * tall),
        (0.45 * wide, 0.25 * tall),
        (0.34 * wide, 0.55 * tall),
    ]
    points += [(0.4 * wide, 0.62 * tall), (0.62 * wide, 0.64 * tall), (0.6 * wide, 0.67 * tall)]
    kind = int(rng.integers(3))
    if kind == 0:
        points += [
            (0.4 * wide, 0.68 * tall),
            (0.62 * wide, 0.86 * tall),
            (0.4 * wide, 0.9 * tall),
            (0.0005, 0.92 * tall),
        ]
        arms = [
            box(0.4 * wide, 0.18 * wide, 0.035).moved(z=0.94 * tall),
            box(0.14 * wide, 0.16 * wide, 0.1 * tall).moved(z=0.9 * tall),
        ]
    elif kind == 1:
        points += [
            (0.36 * wide, 0.68 * tall),
            (0.52 * wide, 0.78 * tall),
            (0.3 * wide, 0.9 * tall),
            (0.0005, 0.95 * tall),
        ]
        arms = [ball(0.13 * wide, 0.13 * wide, 0.13 * wide, 16).moved(z=0.97 * tall)]
    else:
        points += [
            (0.55 * wide, 0.7 * tall),
            (0.6 * wide, 0.88 * tall),
            (0.42 * wide, 0.88 * tall),
            (0.42 * wide, 0.8 * tall),
            (0.0005, 0.8 * tall),
        ]
        arms = [
            box(0.22 * wide, 0.24 * wide, 0.09 * tall, 0.003)
            .moved(0.5 * wide, 0, 0)
            .turned("z", 60 * k)
            .moved(z=0.87 * tall)
            for k in range(6)
        ]
    collar = [hoop(0.55 * wide, 0.2 * tall, 0.07 * wide), hoop(0.45 * wide, 0.6 * tall, 0.06 * wide)]
    return standing(parts_of(stuff, lathe(smooth(points, 5), 56), *collar, *arms))
