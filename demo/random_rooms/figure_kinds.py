# SPDX-License-Identifier: GPL-3.0-or-later
"""Human figures: bust, statuette, mask on a stand."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
from studio.shapes import Shape, ball, box, field, lathe, smooth

from .stuffs import (
    Painted,
    Rng,
    clay,
    cloth,
    glaze,
    ink,
    metal,
    new_seed,
    pick,
    stone,
    uniform,
    wood,
)
from .things import Part, Thing, limb, parts_of, rod, standing


def head(rng: Rng, size: float) -> list[Shape]:
    """Return a head that looks to -Y, with its chin at z = 0: skull with face, nose, ears, hair."""
    long, nose, brow = uniform(rng, 1.2, 1.4), uniform(rng, 0.16, 0.26), uniform(rng, 0.04, 0.08)

    def face(at: np.ndarray) -> np.ndarray:
        x, y, z = (at / size).T
        moved = at.copy()
        ahead = np.clip(-y, 0, None)
        # Jaw narrower than the skull, sockets of the eyes, brow, cheeks, mouth.
        moved[:, 0] *= np.where(z < 0, 1 - 0.28 * np.abs(z), 1)
        relief = brow * np.exp(-((np.abs(x) - 0.35) ** 2) / 0.1 - (z - 0.42) ** 2 / 0.012)
        relief -= 0.13 * np.exp(-((np.abs(x) - 0.38) ** 2) / 0.03 - (z - 0.18) ** 2 / 0.02)
        relief += 0.05 * np.exp(-((np.abs(x) - 0.4) ** 2) / 0.05 - (z + 0.2) ** 2 / 0.05)
        relief += 0.07 * np.exp(-(x**2) / 0.06 - (z + 0.62) ** 2 / 0.008)
        relief -= 0.04 * np.exp(-(x**2) / 0.08 - (z + 0.7) ** 2 / 0.002)
        relief += 0.06 * np.exp(-(x**2) / 0.05 - (z + 0.95) ** 2 / 0.02)
        moved[:, 1] -= size * relief * (ahead > 0.25)
        return moved

    skull = ball(size * 0.86, size, size * long, 56).bent(face)
    ridge = limb(
        [
            (0, -0.95 * size, 0.3 * size),
            (0, -(1 + 0.5 * nose) * size, 0.02 * size),
            (0, -(1 + nose) * size, -0.25 * size),
            (0, -0.9 * size, -0.34 * size),
        ],
        [0.06 * size, 0.08 * size, 0.13 * size, 0.08 * size],
    )
    ears = [ball(0.07 * size, 0.16 * size, 0.26 * size, 16).moved(s * 0.85 * size, 0.02 * size, 0) for s in (-1, 1)]
    shapes = [skull, ridge, *ears]
    style = int(rng.integers(4))
    if style == 0:
        shapes.append(ball(0.95 * size, 0.95 * size, 0.95 * size, 40).moved(0, 0.18 * size, 0.5 * size))
    elif style == 1:  # curls
        for k in range(46):
            turn, up = 2.39996 * k, 0.15 + 0.85 * (k / 46)
            reach = float(np.sqrt(max(0.0, 1 - (up * 0.95) ** 2)))
            x, y = 0.92 * reach * cos(turn), 0.2 + 0.95 * reach * sin(turn)
            if y > -0.5 or up > 0.6:
                shapes.append(
                    ball(0.18 * size, 0.18 * size, 0.16 * size, 12).moved(x * size, y * size, (0.25 + 1.05 * up) * size)
                )
    elif style == 2:  # a knot, and hair to the neck
        shapes.append(ball(0.93 * size, 0.96 * size, 1.0 * size, 40).moved(0, 0.16 * size, 0.42 * size))
        shapes.append(ball(0.4 * size, 0.36 * size, 0.36 * size, 24).moved(0, 1.15 * size, 0.4 * size))
    else:  # a beard and short hair
        shapes.append(ball(0.9 * size, 0.92 * size, 0.9 * size, 40).moved(0, 0.2 * size, 0.48 * size))
        shapes.append(ball(0.5 * size, 0.42 * size, 0.6 * size, 28).moved(0, -0.62 * size, -0.98 * size))
    return [shape.moved(z=long * size) for shape in shapes]


def bust(rng: Rng) -> Thing:
    """Draw a bust: head, neck, shoulders cut below the chest, on a socle."""
    size, turn = uniform(rng, 0.09, 0.125), uniform(rng, -30, 30)
    body = pick(rng, (stone, stone, metal, clay))(rng)
    wide, chest = uniform(rng, 1.7, 2.3) * size, uniform(rng, 1.7, 2.5) * size
    foot = uniform(rng, 0.06, 0.12)
    torso = [(0.35, 0.0), (0.8, 0.2), (1.0, 0.55), (0.92, 0.78), (0.55, 0.93), (0.3, 1.0)]
    trunk = lathe(smooth([(r * wide, z * chest) for r, z in torso], 6), 56).scaled(1, 0.6, 1).moved(z=foot)
    neck = limb(
        [
            (0, 0, foot + 0.9 * chest),
            (0, -0.1 * size, foot + chest + 0.5 * size),
            (0, -0.1 * size, foot + chest + 1.1 * size),
        ],
        [0.58 * size, 0.5 * size, 0.5 * size],
        20,
    )
    skull = [shape.turned("z", turn).moved(z=foot + chest + 0.45 * size) for shape in head(rng, size)]
    socle = [
        (0.0005, 0),
        (0.55 * wide, 0),
        (0.55 * wide, 0.2 * foot),
        (0.3 * wide, 0.6 * foot),
        (0.4 * wide, foot + 0.01),
        (0.0005, foot + 0.01),
    ]
    folds = []
    if rng.random() < 0.6:
        for k in range(4):
            y = -0.5 * wide
            path = [
                (-0.75 * wide, 0.3 * y, foot + (0.72 - 0.04 * k) * chest),
                (-0.2 * wide, 1.2 * y, foot + (0.5 - 0.11 * k) * chest),
                (0.7 * wide, 0.6 * y, foot + (0.66 - 0.12 * k) * chest),
            ]
            folds.append(limb(path, [0.025] * 3, 10))
    second = pick(rng, (stone, wood))(rng)
    return standing([*parts_of(body, trunk, neck, *skull, *folds), Part(lathe(socle, 40), second)])


def statuette(rng: Rng) -> Thing:
    """Draw a standing figure: robe or legs, arms in some pose, on a base."""
    tall = uniform(rng, 0.42, 0.66)
    unit = tall / 8
    body, base = pick(rng, (stone, metal, clay, glaze))(rng), pick(rng, (stone, wood))(rng)
    shapes: list[Shape] = []
    hips, shoulders = 4.2 * unit, 6.4 * unit
    if rng.random() < 0.5:
        robe = [
            (1.3 * unit, 0),
            (1.2 * unit, 0.4 * unit),
            (0.85 * unit, 2.5 * unit),
            (0.75 * unit, 4.2 * unit),
            (0.6 * unit, 4.8 * unit),
        ]
        pleats = int(rng.integers(9, 17))

        def fold(at: np.ndarray) -> np.ndarray:
            turn = np.arctan2(at[:, 1], at[:, 0])
            deep = 1 + 0.09 * np.clip(1 - at[:, 2] / hips, 0, 1) * np.sin(pleats * turn)
            return at * np.stack([deep, 0.8 * deep, np.ones(len(at))], axis=1)

        shapes.append(lathe(smooth(robe, 6), 90).bent(fold))
    else:
        step = uniform(rng, 0.1, 0.5) * unit
        for side in (-1, 1):
            leg = [
                (side * 0.45 * unit, side * step, 0.2 * unit),
                (side * 0.45 * unit, side * 0.7 * step - 0.1 * unit, 2.2 * unit),
                (side * 0.4 * unit, 0, hips),
            ]
            shapes.append(limb(leg, [0.25 * unit, 0.36 * unit, 0.5 * unit], 16))
            shapes.append(
                ball(0.22 * unit, 0.45 * unit, 0.18 * unit, 16).moved(
                    side * 0.45 * unit, side * step - 0.2 * unit, 0.15 * unit
                )
            )
    trunk = [
        (0.7 * unit, 4.0 * unit),
        (0.62 * unit, 4.8 * unit),
        (0.85 * unit, 5.8 * unit),
        (0.95 * unit, 6.3 * unit),
        (0.35 * unit, 6.7 * unit),
    ]
    shapes.append(lathe(smooth(trunk, 6), 40).scaled(1, 0.65, 1))
    held = None
    for side in (-1, 1):
        lift, out = uniform(rng, -1.0, 1.2), uniform(rng, 0.2, 1.0)
        elbow = np.array([side * (1.0 + 0.7 * out) * unit, -0.1 * unit, shoulders + (lift - 1.2) * unit])
        hand = (
            elbow + np.array([side * uniform(rng, -0.6, 0.7), -uniform(rng, 0.3, 0.9), uniform(rng, -0.6, 1.2)]) * unit
        )
        arm = [(side * 0.85 * unit, 0, shoulders - 0.1 * unit), elbow.tolist(), hand.tolist()]
        shapes += [
            limb(arm, [0.3 * unit, 0.24 * unit, 0.17 * unit], 14),
            ball(0.2 * unit, 0.2 * unit, 0.22 * unit, 12).moved(*hand.tolist()),
        ]
        held = hand
    shapes += [shape.moved(z=6.75 * unit) for shape in head(rng, 0.5 * unit)]
    shapes.append(rod((0, 0, 6.5 * unit), (0, 0, 7.1 * unit), 0.26 * unit, 14))
    parts = parts_of(body, *shapes)
    if held is not None and rng.random() < 0.5:
        long = uniform(rng, 2.0, 3.6) * unit
        x, y, z = held.tolist()
        parts.append(Part(rod((x, y, max(0.0, z - long)), (x, y, z + 0.5 * long), 0.08 * unit), metal(rng)))
    high = uniform(rng, 0.03, 0.08)
    parts = [Part(part.shape.moved(z=high), part.stuff) for part in parts]
    if rng.random() < 0.5:
        plate = lathe([(0.0005, 0), (1.7 * unit, 0), (1.7 * unit, high - 0.01), (1.6 * unit, high), (0.0005, high)], 40)
    else:
        plate = box(3.2 * unit, 3.0 * unit, high)
    return standing([*parts, Part(plate, base)])


def mask(rng: Rng) -> Thing:
    """Draw a carved mask on a stand: long or round, with horns, rays or hair."""
    half_wide, half_tall, deep = uniform(rng, 0.11, 0.17), uniform(rng, 0.16, 0.24), uniform(rng, 0.06, 0.11)
    chin, eye_z, mouth_z = uniform(rng, 0.2, 0.55), uniform(rng, 0.1, 0.25), uniform(rng, -0.6, -0.45)
    eye, mouth, nose = uniform(rng, 0.12, 0.19), uniform(rng, 0.14, 0.34), uniform(rng, 0.03, 0.07)

    def outline(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        return (x / (0.97 - chin * np.clip(-z, 0, None) ** 2)) ** 2 + np.abs(z / 0.98) ** 2.4

    def depth(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        a = np.abs(x)
        shape = deep * np.sqrt(np.clip(1.15 - outline(x, z), 0, 1.2))
        shape += nose * np.exp(-((x / 0.12) ** 2)) * np.clip((eye_z + 0.2 - z) / 0.5, 0, 1) * (z > -0.25)
        shape += 0.02 * np.exp(-(((a - 0.4) / 0.28) ** 2) - ((z - eye_z - 0.24) / 0.09) ** 2)
        shape -= 0.02 * np.exp(-(((a - 0.38) / 0.22) ** 2) - ((z - eye_z) / 0.14) ** 2)
        shape += 0.018 * np.exp(-(((a - 0.5) / 0.22) ** 2) - ((z + 0.2) / 0.18) ** 2)
        return shape + 0.02 * np.exp(-((x / (mouth + 0.15)) ** 2) - ((z - mouth_z) / 0.17) ** 2)

    def inside(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        eyes = ((np.abs(x) - 0.38) / eye) ** 2 + ((z - eye_z) / 0.07) ** 2 > 1
        return (outline(x, z) < 1) & eyes & ((x / mouth) ** 2 + ((z - mouth_z) / 0.07) ** 2 > 1)

    front = field(depth, inside, half_wide, half_tall)
    back = front.moved(y=0.012)
    paint = Painted(pick(rng, ("stripes", "clouded", "bands", "checks")), ink(rng), new_seed(rng), (256, 256), 0.55)
    skin = paint if rng.random() < 0.6 else pick(rng, (wood, clay, metal))(rng)
    parts = parts_of(skin, front, back)
    extra, kind = pick(rng, (glaze, cloth, wood))(rng), int(rng.integers(3))
    if kind == 0:
        for side in (-1, 1):
            horn = [
                (side * 0.6 * half_wide, 0, 0.75 * half_tall),
                (side * 1.3 * half_wide, 0, 1.1 * half_tall),
                (side * 1.2 * half_wide, 0.02, 1.6 * half_tall),
            ]
            parts.append(Part(limb(horn, [0.028, 0.022, 0.005], 12), extra))
    elif kind == 1:
        for k in range(13):
            a = pi * k / 12
            root = (0.93 * half_wide * cos(a), 0.0, 0.15 * half_tall + 0.78 * half_tall * sin(a))
            tip = (1.4 * half_wide * cos(a), 0.0, 0.15 * half_tall + 1.25 * half_tall * sin(a))
            parts.append(
                Part(
                    limb(
                        [root, ((root[0] + tip[0]) / 2, -0.01, (root[2] + tip[2]) / 2), tip],
                        [0.02, 0.016, 0.004],
                        8,
                        0.5,
                    ),
                    extra,
                )
            )
    else:
        for k in range(15):
            x = (k / 7 - 1) * 0.9 * half_wide
            z = -0.75 * half_tall * (1 - 0.3 * (x / half_wide) ** 2)
            parts.append(
                Part(
                    limb([(x, 0, z), (1.05 * x, -0.01, z - 0.06), (0.9 * x, 0, z - 0.14)], [0.012, 0.012, 0.004], 8),
                    extra,
                )
            )
    lowest = min(float(part.shape.vertices[:, 2].min()) for part in parts)
    lift = 0.05 - lowest
    parts = [Part(part.shape.moved(z=lift), part.stuff) for part in parts]
    stand = pick(rng, (metal, wood))(rng)
    parts += parts_of(stand, box(0.16, 0.13, 0.02).moved(y=0.02), rod((0, 0.03, 0.01), (0, 0.03, lift), 0.01))
    return standing(parts)
