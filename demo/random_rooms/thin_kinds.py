# SPDX-License-Identifier: GPL-3.0-or-later
"""Thin and hollow exhibits: candelabrum, cage, basket, chair, harp, sphere of rings, lantern, ship, gong, easel."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
from studio.shapes import Shape, ball, box, lathe, loft, ring, slab, smooth

from .round_kinds import bird
from .stuffs import (
    Glass,
    Mottled,
    Painted,
    Plain,
    Rng,
    any_tone,
    cloth,
    decorated,
    glaze,
    ink,
    metal,
    new_seed,
    pick,
    shades,
    tone,
    uniform,
    wood,
)
from .things import Cavity, Part, Thing, around, hoop, limb, parts_of, polar, rod, standing


def candelabrum(rng: Rng) -> Thing:
    """Draw a candlestick with three to seven candles on curved arms, in a row or around the stem."""
    tall, arms, reach = uniform(rng, 0.34, 0.5), int(rng.integers(2, 7)), uniform(rng, 0.13, 0.2)
    cast, wax, wick = (
        metal(rng),
        Plain(tone(uniform(rng, 30, 60), uniform(rng, 0.05, 0.3), 0.92), 0.5),
        Plain("#1c1814", 0.9),
    )
    foot, knop = uniform(rng, 0.09, 0.13), uniform(rng, 0.02, 0.035)
    stem = [
        (0.0005, 0),
        (foot, 0),
        (foot, 0.015),
        (0.4 * foot, 0.04),
        (0.014, 0.2 * tall),
        (knop, 0.35 * tall),
        (0.012, 0.45 * tall),
        (0.011, tall),
    ]
    parts = [Part(lathe(smooth(stem, 6), 40), cast)]
    flat = rng.random() < 0.5
    tops = [(0.0, 0.0, tall)]
    for k, angle in enumerate(around(arms)):
        out = reach
        if flat:
            angle, out = pi * (k % 2), reach * (k // 2 + 1) / ((arms + 1) // 2)
        high = tall - uniform(rng, 0.0, 0.02) - 0.06 * flat * (k // 2)
        path = [
            polar(0.005, angle, 0.55 * tall),
            polar(0.5 * out, angle, 0.5 * tall),
            polar(0.95 * out, angle, 0.65 * tall),
            polar(out, angle, high),
        ]
        parts.append(Part(limb(path, [0.009, 0.009, 0.008, 0.008], 10), cast))
        tops.append(polar(out, angle, high))
    long = uniform(rng, 0.08, 0.18)
    for x, y, z in tops:
        cup = lathe(smooth([(0.006, 0.0), (0.03, 0.012), (0.032, 0.016), (0.015, 0.018), (0.017, 0.04)], 4), 24)
        parts.append(Part(cup.moved(x, y, z), cast))
        burnt = long * uniform(rng, 0.6, 1.0)
        parts.append(Part(lathe([(0.013, 0.02), (0.0125, burnt), (0.0005, burnt + 0.004)], 20).moved(x, y, z), wax))
        parts.append(Part(rod((x, y, z + burnt), (x, y, z + burnt + 0.018), 0.002, 6), wick))
    return standing(parts)


def birdcage(rng: Rng) -> Thing:
    """Draw a round or a square cage of wires with a perch and a bird."""
    wide, tall = uniform(rng, 0.14, 0.2), uniform(rng, 0.3, 0.44)
    wire, floor = metal(rng), pick(rng, (wood, glaze, metal))(rng)
    count, thick = int(rng.integers(16, 26)), uniform(rng, 0.0028, 0.004)
    tray = [
        (0.0005, 0),
        (1.06 * wide, 0),
        (1.08 * wide, 0.035),
        (1.02 * wide, 0.035),
        (1.0 * wide, 0.02),
        (0.0005, 0.02),
    ]
    rise = uniform(rng, 0.5, 1.0) * wide
    parts = [Part(lathe(tray, 56), floor)]
    for angle in around(count):
        path = [polar(wide, angle, 0.02), polar(wide, angle, 0.5 * tall), polar(wide, angle, tall)]
        path += [polar(0.75 * wide, angle, tall + 0.7 * rise), polar(0.02, angle, tall + rise)]
        parts.append(Part(limb(path, [thick] * 5, 6), wire))
    parts += parts_of(wire, *(hoop(wide, z * tall, 0.006) for z in (0.12, 0.55, 1.0)))
    parts.append(Part(ring(0.03, 0.006, 24, 8).turned("x", 90).moved(z=tall + rise + 0.03), wire))
    parts.append(Part(rod((-wide, 0, 0.45 * tall), (wide, 0, 0.45 * tall), 0.007), wood(rng)))
    size = 0.32 * wide
    parts += parts_of(glaze(rng), *bird(size, (0.0, 0.0, 0.45 * tall + 0.68 * size)))
    return standing(parts)


def basket(rng: Rng) -> Thing:
    """Draw a woven basket with or without a handle, which may hold something."""
    x, y, tall = uniform(rng, 0.18, 0.26), uniform(rng, 0.15, 0.2), uniform(rng, 0.14, 0.22)
    flare = uniform(rng, 1.05, 1.25)
    reed = Mottled(shades(rng, uniform(rng, 24, 40), 0.5, uniform(rng, 0.45, 0.75)), 20, 0.8, speckle=0.5)
    second = Mottled(shades(rng, uniform(rng, 0, 360), 0.4, uniform(rng, 0.35, 0.7)), 20, 0.8, speckle=0.5)
    rows, stakes = int(rng.integers(8, 13)), 24
    thick = 0.5 * tall / rows
    parts = [Part(lathe([(0.99, 0.004), (0.0005, 0.006)], 48).scaled(x, y, 1), reed)]
    for row in range(rows):
        z = (row + 0.5) * tall / rows
        wide = 1 + (flare - 1) * z / tall
        turns = np.linspace(0, 2 * pi, 97)
        wave = 1 + 0.035 * np.sin(stakes / 2 * turns + pi * (row % 2))
        path = np.stack([x * wide * wave * np.cos(turns), y * wide * wave * np.sin(turns), np.full(97, z)], axis=1)
        rings = [path + np.array([0, 0, 0])]
        parts.append(Part(_closed(rings[0], thick * 1.05), second if row in (rows // 2, rows // 2 + 1) else reed))
    for angle in around(stakes, pi / stakes):
        foot, head = (
            np.array([x * cos(angle), y * sin(angle), 0.0]),
            np.array([flare * x * cos(angle), flare * y * sin(angle), tall]),
        )
        parts.append(Part(rod(foot, head, 0.006, 6), reed))
    parts.append(Part(ring(1, 0.05, 64).scaled(flare * x, flare * y, 0.25).moved(z=tall), second))
    if rng.random() < 0.6:
        high = uniform(rng, 0.14, 0.24)
        bow = [(flare * x * cos(a), 0, tall + high * sin(a)) for a in np.linspace(0, pi, 11).tolist()]
        parts.append(Part(limb(bow, [0.013] * 11, 10), reed))
    return standing(parts, Cavity(0.62 * x, 0.62 * y, 0.01, tall))


def _closed(path: np.ndarray, thick: float) -> Shape:
    rings = []
    centre = path.mean(axis=0)
    for point in path:
        out = point - centre
        out /= np.linalg.norm(out)
        rings.append([point + thick * (cos(a) * out + sin(a) * np.array([0, 0, 1.0])) for a in around(6)])
    return loft(rings)


def chair(rng: Rng) -> Thing:
    """Draw a chair: four legs, seat, back with slats or a panel, perhaps arms."""
    wide, deep, seat, tall = (
        uniform(rng, 0.4, 0.52),
        uniform(rng, 0.38, 0.46),
        uniform(rng, 0.4, 0.48),
        uniform(rng, 0.82, 1.15),
    )
    timber, thick = wood(rng), uniform(rng, 0.016, 0.024)
    x, y = wide / 2 - thick, deep / 2 - thick
    lean = uniform(rng, 0.03, 0.1)
    shapes = [rod((s * x, -y, 0), (s * x, -y, seat), thick) for s in (-1, 1)]
    shapes += [limb([(s * x, y, 0), (s * x, y, seat), (s * x, y + lean, tall)], [thick] * 3, 10) for s in (-1, 1)]
    shapes += [rod((s * x, -y, 0.4 * seat), (s * x, y, 0.4 * seat), 0.6 * thick) for s in (-1, 1)]
    shapes += [rod((-x, at, 0.5 * seat), (x, at, 0.5 * seat), 0.6 * thick) for at in (-y, y)]
    parts = parts_of(timber, *shapes)
    covered = rng.random() < 0.6
    cushion = decorated(rng, ("stripes", "floral", "diamonds", "carpet"), (256, 256)) if covered else timber
    parts.append(Part(box(wide, deep, 0.05, 0.015).moved(z=seat - 0.02), cushion))
    style = int(rng.integers(3))
    top = box(wide, 0.03, 0.09, 0.01).moved(y=y + lean, z=tall - 0.07)
    parts.append(Part(top, timber))
    if style == 0:
        count = int(rng.integers(3, 7))
        for k in range(count):
            at = (k + 1) / (count + 1) * 2 * x - x
            parts.append(
                Part(
                    limb(
                        [(at, y, seat), (at, y + 0.5 * lean, 0.5 * (seat + tall)), (at, y + lean, tall - 0.05)],
                        [0.01] * 3,
                        8,
                    ),
                    timber,
                )
            )
    elif style == 1:
        for z in np.linspace(seat + 0.12, tall - 0.16, int(rng.integers(2, 4))).tolist():
            parts.append(
                Part(box(2 * x, 0.018, 0.06, 0.006).moved(y=y + lean * (z - seat) / (tall - seat), z=z), timber)
            )
    else:
        panel = box(2 * x - 0.04, 0.03, tall - seat - 0.2, 0.01).moved(y=y + 0.55 * lean, z=seat + 0.1)
        parts.append(Part(panel, cushion))
    if rng.random() < 0.4:
        for side in (-1, 1):
            arm = [
                (side * x, y + 0.4 * lean, seat + 0.22),
                (side * (x + 0.02), 0, seat + 0.23),
                (side * x, -y, seat + 0.2),
            ]
            parts += parts_of(
                timber, limb(arm, [0.016] * 3, 10), rod((side * x, -y, seat), (side * x, -y, seat + 0.2), 0.012)
            )
    return standing(parts)


def harp(rng: Rng) -> Thing:
    """Draw a harp or a lyre with strings, on a foot."""
    tall, wide = uniform(rng, 0.5, 0.72), uniform(rng, 0.26, 0.38)
    frame, string = pick(rng, (wood, metal))(rng), Plain("#d8cfb4", 0.3, 0.4)
    foot = box(0.55 * wide, 0.16, 0.035)
    parts = [Part(foot, frame)]
    half, thick = wide / 2, uniform(rng, 0.016, 0.022)
    if rng.random() < 0.5:
        sound = [
            (-0.6 * half, 0, 0.04),
            (-0.8 * half, 0, 0.2 * tall),
            (0, 0, 0.32 * tall),
            (0.8 * half, 0, 0.2 * tall),
            (0.6 * half, 0, 0.04),
        ]
        outline = smooth([(px, pz) for px, _, pz in sound], 6)
        parts.append(Part(slab(outline, 0.07, 0.008).moved(y=0.035), frame))
        for side in (-1, 1):
            arm = [
                (side * 0.65 * half, 0, 0.22 * tall),
                (side * half, 0, 0.45 * tall),
                (side * 0.6 * half, 0, 0.75 * tall),
                (side * 0.95 * half, 0, tall),
            ]
            parts.append(Part(limb(arm, [thick, thick, 0.8 * thick, thick], 12), frame))
        parts.append(Part(rod((-0.8 * half, 0, 0.86 * tall), (0.8 * half, 0, 0.86 * tall), 0.013), frame))
        ends = [
            ((0.06 * (k - 3) * half * 2.2, -0.04, 0.14 * tall), (0.09 * (k - 3) * half * 2.2, -0.012, 0.86 * tall))
            for k in range(7)
        ]
    else:
        column = limb(
            [(-half, 0, 0.03), (-1.02 * half, 0, 0.5 * tall), (-0.95 * half, 0, tall)],
            [1.1 * thick, thick, 1.2 * thick],
            14,
        )
        body = limb(
            [(-0.8 * half, 0, 0.05), (0.2 * half, 0, 0.38 * tall), (half, 0, 0.78 * tall)],
            [1.2 * thick, 1.8 * thick, 1.3 * thick],
            14,
        )
        neck = limb(
            [
                (-0.95 * half, 0, 0.98 * tall),
                (-0.5 * half, 0, 0.9 * tall),
                (0.2 * half, 0, 0.93 * tall),
                (half, 0, 0.79 * tall),
            ],
            [thick] * 4,
            14,
        )
        parts += parts_of(frame, column, body, neck)
        ends = []
        for k in range(11):
            x = (-0.75 + 0.15 * k) * half
            at = float(np.interp(x / half, (-0.8, 0.2, 1.0), (0.05, 0.38, 0.78))) * tall
            ends.append(((x, 0.0, at), (x, 0.0, 0.91 * tall)))
    parts += parts_of(string, *(rod(a, b, 0.0026, 5) for a, b in ends))
    return standing(parts)


def armillary(rng: Rng) -> Thing:
    """Draw an armillary sphere: crossed rings around a small globe, on a turned stand."""
    radius, base = uniform(rng, 0.15, 0.22), uniform(rng, 0.1, 0.2)
    brass, centre = metal(rng), base + radius
    tilt = uniform(rng, 15, 35)
    rings = [ring(radius, 0.007, 64).turned("x", 90), ring(radius * 0.97, 0.007, 64).turned("x", 90).turned("z", 90)]
    rings += [ring(radius * 0.94, 0.012, 64).scaled(1, 1, 0.9).turned("y", 23)]
    rings += [ring(radius * cos(a), 0.005, 56).moved(z=radius * sin(a)) for a in (-0.45, 0.0, 0.45)]
    rings.append(rod((0, 0, -radius), (0, 0, radius), 0.005))
    parts = parts_of(brass, *(shape.turned("y", tilt).moved(z=centre) for shape in rings))
    parts.append(Part(ball(0.25 * radius, 0.25 * radius, 0.25 * radius, 24).moved(z=centre), glaze(rng)))
    parts.append(Part(ring(radius * 1.06, 0.011, 64).scaled(1, 1, 0.7).moved(z=centre), wood(rng)))
    foot = [
        (0.0005, 0),
        (0.11, 0),
        (0.11, 0.016),
        (0.03, 0.04),
        (0.018, 0.5 * base),
        (0.028, 0.8 * base),
        (0.012, base + 0.01),
    ]
    parts.append(Part(lathe(smooth(foot, 6), 40), wood(rng)))
    return standing(parts)


def lantern(rng: Rng) -> Thing:
    """Draw a lantern: metal frame with four or six panes around a candle, a roof and a ring."""
    wide, tall, sides = uniform(rng, 0.1, 0.14), uniform(rng, 0.24, 0.34), pick(rng, (4, 6))
    iron = metal(rng)
    pane = Glass(tone(uniform(rng, 20, 220), uniform(rng, 0.1, 0.5), 0.85), 0.12)
    base = lathe([(0.0005, 0), (1.15 * wide, 0), (1.15 * wide, 0.03), (0.0005, 0.03)], sides)
    roof = lathe(
        [
            (1.2 * wide, tall),
            (0.45 * wide, tall + 0.6 * wide),
            (0.45 * wide, tall + 0.85 * wide),
            (0.0005, tall + 0.95 * wide),
        ],
        sides,
    )
    parts = parts_of(iron, base, roof, ring(0.04, 0.006, 24).turned("x", 90).moved(z=tall + 0.95 * wide + 0.035))
    corners = around(sides)
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        parts.append(Part(rod(polar(wide, a, 0.03), polar(wide, a, tall), 0.008), iron))
        for z in (0.03, 0.55 * tall, tall):
            parts.append(Part(rod(polar(wide, a, z), polar(wide, b, z), 0.005), iron))
        parts.append(
            Part(
                loft(
                    [
                        [polar(wide * 0.99, a, z), polar(wide * 0.99, b, z), polar(wide * 0.97, b, z)]
                        for z in (0.03, tall)
                    ]
                ),
                pane,
            )
        )
    parts.append(Part(lathe([(0.028, 0.03), (0.027, 0.5 * tall), (0.0005, 0.52 * tall)], 24), Plain("#efe6cc", 0.5)))
    return standing(parts)


def ship(rng: Rng) -> Thing:
    """Draw a model of a sailing ship: hull, masts, sails, shrouds, on a cradle."""
    long, masts = uniform(rng, 0.45, 0.65), int(rng.integers(2, 4))
    hull_stuff, deck = wood(rng), wood(rng)
    wide, deep = 0.16 * long, 0.14 * long
    rings = []
    for t in np.linspace(0, 1, 17).tolist():
        half = wide * (
            sin(pi * min(1.0, 0.12 + 0.9 * t)) ** 0.6 if t < 0.55 else max(0.03, (cos(pi * (t - 0.55) / 0.9)) ** 0.8)
        )
        sheer = 0.28 * deep * (2 * t - 0.9) ** 2
        x = (t - 0.5) * long
        keel = deep * (0.2 + 0.8 * max(0.0, 2 * t - 1.2) ** 2)
        rings.append(
            [
                (x, half * cos(a), deep + sheer + (deep + sheer - 0.3 * keel) * -sin(a) * 0.95)
                for a in np.linspace(0, pi, 15).tolist()
            ]
        )
    lift = 0.09
    parts = [Part(loft(rings).moved(z=lift), hull_stuff)]
    parts.append(Part(box(0.8 * long, 1.1 * wide, 0.008).moved(z=lift + deep + 0.012), deck))
    sailcloth = Mottled(shades(rng, uniform(rng, 30, 60), uniform(rng, 0.05, 0.3), 0.85, 0.2), 25, 0.9, speckle=0.4)
    line, top = Plain("#3a2c1e", 0.8), lift + deep
    flag = Plain(any_tone(rng, (0.5, 0.85), (0.6, 0.9)), 0.7)
    for k in range(masts):
        x = (k - (masts - 1) / 2) * 0.62 * long / masts
        tall = long * uniform(rng, 0.62, 0.78) * (1.0 if k == masts // 2 else 0.88)
        parts.append(Part(rod((x, 0, top), (x, 0, top + tall), 0.008), deck))
        rows = int(rng.integers(2, 4))
        for row in range(rows):
            low, high = top + tall * (0.14 + 0.8 * row / rows), top + tall * (0.14 + 0.8 * (row + 0.86) / rows)
            half = 0.17 * long * (1 - 0.2 * row)
            sheet = [
                [
                    (x + 0.05 * long * sin(pi * t) + d, (u - 0.5) * 2 * half * (1.06 - 0.1 * t), low + (high - low) * t)
                    for u, d in ((0, 0), (0.5, 0.016), (1, 0), (1, -0.003), (0.5, 0.013), (0, -0.003))
                ]
                for t in np.linspace(0, 1, 7).tolist()
            ]
            parts += [Part(loft(sheet), sailcloth), Part(rod((x, -half, high), (x, half, high), 0.005), deck)]
        for side in (-1, 1):
            for step in (-0.04, 0.0, 0.04):
                parts.append(
                    Part(rod((x + step * long, side * 0.9 * wide, top), (x, 0, top + 0.85 * tall), 0.0022, 5), line)
                )
        parts.append(Part(box(0.06, 0.004, 0.035, 0).moved(x - 0.03, 0, top + tall - 0.035), flag))
    bow = (0.5 * long, 0.0, top + 0.02)
    parts.append(Part(rod(bow, (0.68 * long, 0, top + 0.1 * long), 0.007), deck))
    for x in (-0.22 * long, 0.22 * long):
        parts.append(Part(box(0.03, 1.8 * wide, lift + 0.3 * deep).moved(x=x), hull_stuff))
    parts.append(Part(box(0.7 * long, 1.9 * wide, 0.02), hull_stuff))
    return standing(parts)


def gong(rng: Rng) -> Thing:
    """Draw a gong: a bronze disc that hangs in a frame."""
    radius = uniform(rng, 0.15, 0.22)
    cast, timber = metal(rng), pick(rng, (wood, glaze))(rng)
    disc = [
        (0.0005, 0.035),
        (0.25 * radius, 0.03),
        (0.3 * radius, 0.012),
        (0.9 * radius, 0.004),
        (radius, 0.0),
        (radius, -0.03),
    ]
    plate = lathe(smooth(disc, 5), 64).turned("x", 90)
    wide, tall = radius + 0.07, 2 * radius + 0.16
    parts = [Part(plate.moved(z=radius + 0.08), cast)]
    parts += parts_of(timber, *(rod((s * wide, 0, 0), (s * wide, 0, tall), 0.018, 12) for s in (-1, 1)))
    parts += parts_of(
        timber,
        rod((-wide - 0.05, 0, tall), (wide + 0.05, 0, tall), 0.02, 12),
        rod((-wide, 0, 0.05), (wide, 0, 0.05), 0.014, 12),
    )
    parts += parts_of(timber, *(box(0.05, 0.26, 0.03).moved(x=s * wide) for s in (-1, 1)))
    cord = cloth(rng)
    parts += parts_of(
        cord,
        *(
            rod((s * 0.5 * radius, 0.01, radius + 0.08 + 0.8 * radius), (s * 0.6 * radius, 0, tall), 0.004)
            for s in (-1, 1)
        ),
    )
    return standing(parts)


def easel(rng: Rng) -> Thing:
    """Draw an easel with a canvas."""
    tall, wide = uniform(rng, 1.15, 1.45), uniform(rng, 0.42, 0.62)
    timber = wood(rng)
    canvas_tall = uniform(rng, 0.42, 0.6)
    low = uniform(rng, 0.5, 0.6)
    parts = parts_of(timber, *(rod((s * 0.5 * wide, -0.16, 0), (s * 0.06, 0.06, tall), 0.016) for s in (-1, 1)))
    parts += parts_of(
        timber,
        rod((0, 0.42, 0), (0, 0.08, 0.95 * tall), 0.014),
        rod((-0.34, -0.16 + 0.2 * low, 0.45), (0.34, -0.16 + 0.2 * low, 0.45), 0.014),
    )
    picture = Painted(
        pick(rng, ("landscape", "abstract", "portrait", "floral")), ink(rng), new_seed(rng), (512, 512), 0.7
    )
    lean = -8.0
    board = box(wide, 0.025, canvas_tall, 0.003).turned("x", lean).moved(y=-0.1, z=low)
    sheet = slab(
        [
            (-0.48 * wide, 0.01),
            (0.48 * wide, 0.01),
            (0.48 * wide, canvas_tall - 0.01),
            (-0.48 * wide, canvas_tall - 0.01),
        ],
        0.004,
    )
    parts += [Part(board, timber), Part(sheet.moved(y=-0.0125).turned("x", lean).moved(y=-0.1, z=low), picture)]
    parts.append(Part(box(wide + 0.06, 0.08, 0.02).moved(y=-0.11, z=low - 0.025), timber))
    return standing(parts)


def anchor(rng: Rng) -> Thing:
    """Draw an anchor that stands on its crown in a block, with a ring."""
    tall, wide = uniform(rng, 0.5, 0.75), uniform(rng, 0.2, 0.28)
    iron, timber = metal(rng), wood(rng)
    thick = uniform(rng, 0.018, 0.026)
    arc = [(wide * sin(t), 0, 0.1 + wide * (1 - cos(t))) for t in np.linspace(-1.35, 1.35, 11).tolist()]
    parts = [Part(limb(arc, [0.6 * thick, *([thick] * 9), 0.6 * thick], 12), iron)]
    for side in (-1, 1):
        x, z = side * wide * sin(1.3), 0.1 + wide * (1 - cos(1.3))
        fluke = slab([(-0.055, -0.05), (0.055, -0.05), (0.0, 0.08)], 0.016).moved(y=0.008)
        parts.append(Part(fluke.turned("y", side * 20).moved(x, 0, z), iron))
    parts.append(
        Part(limb([(0, 0, 0.1), (0, 0, 0.5 * tall), (0, 0, tall)], [1.1 * thick, thick, 0.8 * thick], 12), iron)
    )
    parts.append(Part(rod((0, -0.8 * wide, 0.84 * tall), (0, 0.8 * wide, 0.84 * tall), 0.8 * thick, 12), timber))
    parts.append(Part(ring(0.05, 0.011, 32).turned("x", 90).moved(z=tall + 0.05), iron))
    parts.append(Part(box(0.3, 0.26, 0.11), timber))
    return standing(parts)
