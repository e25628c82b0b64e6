# SPDX-License-Identifier: GPL-3.0-or-later
"""Exhibits that are boxes: chest, jewelry box, book, radio, birdhouse, crate."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
from studio.shapes import Shape, ball, box, lathe, loft, quad, slab

from .stuffs import (
    Mottled,
    Painted,
    Plain,
    Rng,
    any_tone,
    cloth,
    darker,
    decorated,
    glaze,
    ink,
    metal,
    new_seed,
    pick,
    stone,
    uniform,
    wood,
)
from .things import Cavity, Part, Thing, around, hoop, limb, parts_of, rod, standing


def chest(rng: Rng) -> Thing:
    """Draw a chest with iron bands, its lid round or flat."""
    wide, deep, low = uniform(rng, 0.5, 0.8), uniform(rng, 0.3, 0.44), uniform(rng, 0.22, 0.34)
    timber, iron = wood(rng), darker(metal(rng), 0.8)
    rise = uniform(rng, 0.02, 0.5) * deep
    planks = int(rng.integers(2, 5))
    parts = [
        Part(box(wide, deep, low / planks - 0.004, 0.006).moved(z=low * k / planks), timber) for k in range(planks)
    ]
    parts.append(Part(_arch(wide, deep, rise, 0.04).moved(z=low), timber))
    for x in np.linspace(-0.42, 0.42, int(rng.integers(2, 5))).tolist():
        parts += parts_of(
            iron,
            _arch(0.05, deep + 0.014, rise + 0.007, 0.04).moved(x=x * wide, z=low),
            box(0.05, deep + 0.014, low, 0.003).moved(x=x * wide),
        )
    lock = box(0.11, 0.02, 0.13, 0.008).moved(y=-deep / 2 - 0.012, z=low - 0.09)
    parts += [
        Part(lock, metal(rng)),
        Part(box(0.015, 0.005, 0.04, 0).moved(y=-deep / 2 - 0.023, z=low - 0.06), Plain("#0c0a08")),
    ]
    for side in (-1, 1):
        x = side * (wide / 2 + 0.015)
        parts.append(
            Part(
                limb([(x, -0.07, 0.6 * low), (x + side * 0.02, 0, 0.5 * low), (x, 0.07, 0.6 * low)], [0.01] * 3, 8),
                iron,
            )
        )
    return standing(parts)


def _arch(wide: float, deep: float, rise: float, wall: float) -> Shape:
    """Return a lid: a straight wall and an arch above it, along X."""
    arc = [(-deep / 2 * cos(a), wall + rise * sin(a)) for a in np.linspace(0, pi, 17).tolist()]
    outline = [(-deep / 2, 0.0), *arc, (deep / 2, 0.0)]
    return loft([[(x, y, z) for y, z in outline] for x in (-wide / 2, wide / 2)])


def jewelry_box(rng: Rng) -> Thing:
    """Draw a small precious box, open or closed, on feet; an open one shows strings of pearls."""
    wide, deep, low = uniform(rng, 0.24, 0.34), uniform(rng, 0.17, 0.24), uniform(rng, 0.1, 0.16)
    body = decorated(rng, ("diamonds", "floral", "bands", "clouded"), (256, 512), roughness=0.35)
    gold, lining = metal(rng), cloth(rng)
    feet, wall = 0.025, 0.012
    parts = [
        Part(ball(0.02, 0.02, 0.016, 14).moved(sx * 0.42 * wide, sy * 0.42 * deep, 0.014), gold)
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    parts.append(Part(box(wide, deep, wall).moved(z=feet), body))
    for side in (-1, 1):
        parts.append(Part(box(wide, wall, low, 0.003).moved(y=side * (deep - wall) / 2, z=feet), body))
        parts.append(Part(box(wall, deep, low, 0.003).moved(x=side * (wide - wall) / 2, z=feet), body))
    bed = feet + 0.6 * low
    parts.append(Part(box(wide - 2 * wall, deep - 2 * wall, 0.6 * low - wall, 0).moved(z=feet + wall), lining))
    angle = pick(rng, (0.0, uniform(rng, 60, 105)))
    lid = (
        box(wide + 0.01, deep + 0.01, 0.03, 0.006)
        .moved(y=-deep / 2)
        .turned("x", -angle)
        .moved(y=deep / 2, z=feet + low)
    )
    parts.append(Part(lid, body))
    if angle:
        for _ in range(int(rng.integers(14, 26))):
            at = (uniform(rng, -0.4, 0.4) * wide, uniform(rng, -0.36, 0.36) * deep, bed + 0.008)
            size = uniform(rng, 0.008, 0.017)
            parts.append(
                Part(ball(size, size, size, 12).moved(*at), pick(rng, (gold, Plain(any_tone(rng, (0.5, 0.9)), 0.2))))
            )
    for sx in (-1, 1):
        for sy in (-1, 1):
            parts.append(
                Part(
                    box(0.02, 0.02, low + 0.004, 0.004).moved(sx * (wide / 2 - 0.006), sy * (deep / 2 - 0.006), feet),
                    gold,
                )
            )
    parts.append(Part(box(0.04, 0.01, 0.05, 0.004).moved(y=-deep / 2 - 0.004, z=feet + low - 0.05), gold))
    return standing(parts)


def book(rng: Rng) -> Thing:
    """Draw a large old book: open on a sloping rest, or closed and standing on one."""
    wide, tall = uniform(rng, 0.22, 0.3), uniform(rng, 0.3, 0.4)
    leather, rest = cloth(rng), wood(rng)
    slope = uniform(rng, 18, 40)
    parts: list[Part] = []
    if rng.random() < 0.55:
        paper = ("#e9dfc4", "#3a2a1c", any_tone(rng), any_tone(rng))
        thick = uniform(rng, 0.03, 0.05)
        for side in (-1, 1):
            # The page rises from the spine and falls to the edge.
            ends = []
            for y in (-tall / 2, tall / 2):
                ends.append(
                    [
                        (side * wide * t, y, 0.008 + thick * (0.25 + 1.6 * t**0.5 * (1.1 - t)))
                        for t in np.linspace(0, 1, 9).tolist()
                    ]
                )
            sheet = Painted("pages", paper, new_seed(rng), (512, 384), 0.8, wear=0.2)
            for k in range(8):
                a, b, c, d = ends[0][k], ends[0][k + 1], ends[1][k + 1], ends[1][k]
                order = [a, b, c, d] if side > 0 else [b, a, d, c]
                piece = quad(order)
                left = k / 8 if side > 0 else 1 - (k + 1) / 8
                uvs = np.array([[(left, 0), (left + 0.125, 0), (left + 0.125, 1), (left, 1)]])
                parts.append(Part(Shape(piece.vertices, piece.quads, uvs), sheet))
            parts.append(
                Part(
                    box(wide, tall, thick * 0.8, 0.004).moved(x=side * wide / 2, z=0.006),
                    Mottled(((0.3, "#cfc2a0"), (0.7, "#e9dfc4")), 40, stretch=(1, 1, 40)),
                )
            )
            parts.append(Part(box(wide + 0.012, tall + 0.02, 0.006, 0.002).moved(x=side * (wide / 2 + 0.004)), leather))
        half = wide + 0.02
    else:
        thick = uniform(rng, 0.05, 0.09)
        front = Painted("cover", ink(rng), new_seed(rng), (512, 384), 0.6)
        parts.append(Part(box(wide, tall, thick, 0.004), Mottled(((0.3, "#cfc2a0"), (0.7, "#e9dfc4")), 40)))
        parts.append(Part(box(wide + 0.014, tall + 0.02, 0.008, 0.002).moved(x=0.004, z=thick), front))
        parts.append(Part(box(wide + 0.014, tall + 0.02, 0.008, 0.002).moved(x=0.004, z=-0.008), leather))
        parts.append(Part(box(0.01, tall + 0.02, thick + 0.01, 0.004).moved(x=-wide / 2 - 0.004, z=-0.004), leather))
        parts = [Part(part.shape.moved(z=0.008), part.stuff) for part in parts]
        half = wide / 2 + 0.01
    tilted = [Part(part.shape.moved(y=tall / 2).turned("x", slope).moved(z=0.02), part.stuff) for part in parts]
    long = tall * cos(slope * pi / 180)
    high = tall * sin(slope * pi / 180)
    side_view = [(0.0, 0.0), (long, 0.0), (long, high + 0.012), (0.0, 0.012)]
    wedge = loft([[(x, y, z) for y, z in side_view] for x in (-0.7 * half, 0.7 * half)])
    lip = box(1.6 * half, 0.02, 0.06).moved(y=-0.012)
    return standing([*tilted, *parts_of(rest, wedge, lip)])


def radio(rng: Rng) -> Thing:
    """Draw an old radio: wooden case, speaker cloth, dial and knobs."""
    wide, deep, tall = uniform(rng, 0.38, 0.52), uniform(rng, 0.18, 0.25), uniform(rng, 0.25, 0.34)
    timber, gold = wood(rng), metal(rng)
    parts = [Part(box(wide, deep, tall, uniform(rng, 0.01, 0.05)).moved(z=0.02), timber)]
    parts += parts_of(timber, *(box(0.05, 0.9 * deep, 0.022).moved(x=s * 0.4 * wide) for s in (-1, 1)))
    y, split = -deep / 2 - 0.001, uniform(rng, 0.42, 0.6)
    weave = Painted(pick(rng, ("checks", "diamonds", "stripes")), ink(rng), new_seed(rng), (256, 256), 0.9)
    parts.append(Part(_panel(-0.44 * wide, (split - 0.48) * wide, 0.12 * tall + 0.02, 0.9 * tall + 0.02, y), weave))
    left, right = (split - 0.44) * wide, 0.44 * wide
    scale = Painted("pages", ("#f0e2b8", "#3a2414", any_tone(rng), any_tone(rng)), new_seed(rng), (256, 256), 0.3)
    parts.append(Part(_panel(left, right, 0.5 * tall + 0.02, 0.9 * tall + 0.02, y), scale))
    for k in range(int(rng.integers(2, 4))):
        x = left + (k + 0.5) * (right - left) / 3
        knob = lathe([(0.028, 0), (0.028, 0.015), (0.022, 0.03), (0.0005, 0.032)], 24).turned("x", 90)
        parts.append(Part(knob.moved(x, y, 0.27 * tall + 0.02), gold))
    frame = [
        (-0.46 * wide, 0.1 * tall + 0.02),
        (0.46 * wide, 0.1 * tall + 0.02),
        (0.46 * wide, 0.93 * tall + 0.02),
        (-0.46 * wide, 0.93 * tall + 0.02),
    ]
    parts += parts_of(
        gold, *(rod((a[0], y, a[1]), (b[0], y, b[1]), 0.005) for a, b in zip(frame, frame[1:] + frame[:1], strict=True))
    )
    return standing(parts)


def _panel(left: float, right: float, low: float, high: float, y: float) -> Shape:
    return quad([(left, y, low), (right, y, low), (right, y, high), (left, y, high)])


def birdhouse(rng: Rng) -> Thing:
    """Draw a birdhouse with a gable roof, a round hole and a perch, on a post."""
    wide, deep, tall = uniform(rng, 0.2, 0.28), uniform(rng, 0.18, 0.26), uniform(rng, 0.2, 0.3)
    post, rise = uniform(rng, 0.06, 0.2), uniform(rng, 0.1, 0.2)
    wall, roof = (glaze if rng.random() < 0.6 else wood)(rng), pick(rng, (glaze, wood, stone))(rng)
    parts = [Part(box(0.2, 0.2, 0.03), roof), Part(box(0.05, 0.05, post), roof)]
    gable = [(-wide / 2, 0.0), (wide / 2, 0.0), (wide / 2, tall), (0.0, tall + rise), (-wide / 2, tall)]
    parts.append(Part(slab(gable, deep).moved(y=deep / 2, z=post), wall))
    lean = float(np.degrees(np.arctan2(rise, wide / 2)))
    long = float(np.hypot(rise, wide / 2)) + 0.06
    for side in (-1, 1):
        sheet = box(long, deep + 0.1, 0.018).moved(x=side * long / 2).turned("y", side * lean)
        parts.append(Part(sheet.moved(z=post + tall + rise), roof))
    hole, z = uniform(rng, 0.03, 0.045), post + 0.6 * tall
    disc = lathe([(hole, 0), (0.0005, 0.0)], 28).turned("x", 90).moved(y=-deep / 2 - 0.002, z=z)
    parts += [
        Part(disc, Plain("#0d0b09", 0.9)),
        Part(hoop(hole, 0, 0.007).turned("x", 90).moved(y=-deep / 2, z=z), roof),
    ]
    parts.append(Part(rod((0, -deep / 2, z - 1.7 * hole), (0, -deep / 2 - 0.07, z - 1.7 * hole), 0.008), roof))
    return standing(parts)


def crate(rng: Rng) -> Thing:
    """Draw an open crate of slats, which may hold something."""
    x, y, tall = uniform(rng, 0.2, 0.28), uniform(rng, 0.16, 0.22), uniform(rng, 0.2, 0.3)
    timber, rows = wood(rng), int(rng.integers(2, 4))
    parts = [Part(box(2 * x, 2 * y, 0.02), timber)]
    for k in range(rows):
        z = 0.03 + k * (tall - 0.03) / rows
        board = (tall - 0.03) / rows - uniform(rng, 0.012, 0.03)
        for side in (-1, 1):
            parts.append(Part(box(2 * x, 0.016, board, 0.004).moved(y=side * y, z=z), timber))
            parts.append(Part(box(0.016, 2 * y, board, 0.004).moved(x=side * x, z=z), timber))
    for sx in (-1, 1):
        for sy in (-1, 1):
            parts.append(Part(box(0.035, 0.035, tall).moved(sx * (x - 0.026), sy * (y - 0.026)), timber))
    straw = Mottled(((0.3, "#a8853c"), (0.7, "#ead08a")), 60, 0.9, speckle=0.6)
    bed = uniform(rng, 0.25, 0.5) * tall
    parts.append(Part(box(2 * x - 0.03, 2 * y - 0.03, bed, 0.02).moved(z=0.02), straw))
    for _ in range(50):
        turn, half = uniform(rng, 0, pi), uniform(rng, 0.03, 0.06)
        at = np.array([uniform(rng, -0.75, 0.75) * x, uniform(rng, -0.7, 0.7) * y, bed + uniform(rng, 0.018, 0.035)])
        step = np.array([half * cos(turn), half * sin(turn), 0.3 * half * float(rng.normal())])
        parts.append(Part(rod(at - step, at + step, 0.003, 5), straw))
    return standing(parts, Cavity(x - 0.06, y - 0.06, bed + 0.02, tall))


def toy_blocks(rng: Rng) -> Thing:
    """Draw a stack of toy blocks with pictures."""
    size = uniform(rng, 0.11, 0.15)
    count = int(rng.integers(3, 6))
    parts = []
    for k in range(count):
        block = Painted(
            pick(rng, ("cover", "floral", "checks", "abstract", "blobs")), ink(rng), new_seed(rng), (256, 256)
        )
        level, column = divmod(k, 3)
        x = (column - 1) * 1.12 * size if level == 0 else (column - 0.5) * 1.05 * size
        shape = box(size, size, size, 0.006).turned("z", uniform(rng, -12, 12))
        parts.append(Part(shape.moved(x, 0, level * size), block))
    return standing(parts)


def accordion(rng: Rng) -> Thing:
    """Draw an accordion: two cases with keys and buttons, and pleated bellows between them."""
    wide, tall, deep = uniform(rng, 0.34, 0.5), uniform(rng, 0.24, 0.34), uniform(rng, 0.14, 0.19)
    case, pearl = glaze(rng), Plain("#ece4d2", 0.3)
    end = 0.09
    parts = [Part(box(end, deep, tall, 0.015).moved(x=s * (wide - end) / 2), case) for s in (-1, 1)]
    folds = int(rng.integers(7, 13))
    cloths = (cloth(rng), cloth(rng))
    span = (wide - 2 * end) / folds
    for k in range(folds):
        x = -wide / 2 + end + (k + 0.5) * span
        parts.append(Part(box(0.7 * span, deep - 0.01, tall - 0.03, 0.4 * span).moved(x=x, z=0.015), cloths[k % 2]))
        parts.append(Part(box(span, deep - 0.05, tall - 0.06, 0).moved(x=x, z=0.03), cloths[(k + 1) % 2]))
    keys = int(rng.integers(9, 14))
    for k in range(keys):
        z = 0.02 + (k + 0.5) * (tall - 0.04) / keys
        parts.append(
            Part(
                box(0.06, 0.02, 0.8 * (tall - 0.04) / keys, 0.002).moved(wide / 2 - 0.04, -deep / 2 - 0.008, z - 0.008),
                pearl,
            )
        )
    for k, angle in enumerate(around(12)):
        at = (-wide / 2 + 0.03 + 0.03 * (k % 2), -deep / 2 - 0.003, 0.03 + (tall - 0.06) * angle / 6.3)
        parts.append(Part(ball(0.008, 0.005, 0.008, 10).moved(*at), pearl))
    return standing(parts)
