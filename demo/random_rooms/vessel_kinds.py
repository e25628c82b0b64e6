# SPDX-License-Identifier: GPL-3.0-or-later
"""Exhibits turned on a wheel or a lathe: vessels, bell, sand glass, drum, barrel, plant in a pot."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
from studio.shapes import Shape, ball, lathe, loft, smooth

from .stuffs import (
    Glass,
    Mottled,
    Painted,
    Plain,
    Rng,
    Stuff,
    any_tone,
    clay,
    cloth,
    darker,
    decorated,
    glaze,
    metal,
    pick,
    stone,
    tone,
    uniform,
    wood,
)
from .things import Cavity, Part, Thing, around, hoop, limb, parts_of, polar, rod, standing

PATTERNS = ("bands", "floral", "diamonds", "checks", "stripes", "blobs", "clouded")


def skin(rng: Rng) -> Mottled | Painted:
    """Draw the surface of a vessel: painted, glazed, or bare clay, metal or stone."""
    if rng.random() < 0.6:
        return decorated(rng, PATTERNS, roughness=uniform(rng, 0.3, 0.6), wear=uniform(rng, 0.05, 0.35))
    return pick(rng, (glaze, clay, metal, stone))(rng)


def trim(rng: Rng, body: Stuff) -> Stuff:
    """Draw the material of handles and lids: that of the body, or another one where the body is painted."""
    return body if isinstance(body, Mottled) and rng.random() < 0.7 else pick(rng, (glaze, metal))(rng)


def handle(inner: float, low: float, high: float, reach: float, thick: float, angle: float) -> Shape:
    """Return a bow from a body of radius `inner` at two heights, in the direction of an angle in degrees."""
    tall = high - low
    points = [
        (inner * 0.9, 0, high),
        (inner + reach * 0.7, 0, high + 0.08 * tall),
        (inner + reach, 0, high - 0.3 * tall),
        (inner + reach * 0.75, 0, low + 0.25 * tall),
        (inner * 0.95, 0, low),
    ]
    return limb(points, [thick] * 5, 12, 1.3).turned("z", angle)


def vase(rng: Rng) -> Thing:
    """Draw a vase without handles: foot, belly or cylinder, neck and lip."""
    tall, belly = uniform(rng, 0.34, 0.62), uniform(rng, 0.1, 0.17)
    widest, neck, lip, foot = (
        uniform(rng, 0.3, 0.7),
        uniform(rng, 0.3, 0.75),
        uniform(rng, 0.5, 1.0),
        uniform(rng, 0.5, 0.8),
    )
    points = [
        (foot * belly, 0.0),
        (foot * belly, 0.02 * tall),
        (0.5 * (foot + 1) * belly, 0.5 * widest * tall),
        (belly, widest * tall),
        (0.75 * belly + 0.1 * neck * belly, (widest + 0.5 * (0.84 - widest)) * tall),
        (neck * belly, 0.84 * tall),
        (lip * belly, 0.985 * tall),
        (lip * belly * 0.97, tall),
        (neck * belly * 0.85, 0.86 * tall),
        (0.4 * belly, 0.7 * tall),
    ]
    return standing(parts_of(skin(rng), lathe(smooth(points, 6), 72)))


def amphora(rng: Rng) -> Thing:
    """Draw a slender amphora with two handles at its neck, on a foot."""
    tall, belly = uniform(rng, 0.45, 0.72), uniform(rng, 0.12, 0.18)
    neck, widest = uniform(rng, 0.3, 0.45) * belly, uniform(rng, 0.45, 0.6) * tall
    points = [
        (0.45 * belly, 0.0),
        (0.42 * belly, 0.03 * tall),
        (0.22 * belly, 0.06 * tall),
        (0.65 * belly, 0.25 * tall),
        (belly, widest),
        (0.8 * belly, widest + 0.14 * tall),
        (neck, 0.78 * tall),
        (neck * 0.95, 0.92 * tall),
        (neck * 1.5, 0.99 * tall),
        (neck * 1.4, tall),
        (neck * 0.8, 0.92 * tall),
        (neck * 0.7, 0.75 * tall),
    ]
    body = skin(rng)
    reach, thick = uniform(rng, 0.5, 0.95) * belly, uniform(rng, 0.011, 0.018)
    handles = [handle(neck, 0.7 * tall, 0.92 * tall, reach, thick, angle) for angle in (0, 180)]
    return standing([Part(lathe(smooth(points, 6), 72), body), *parts_of(trim(rng, body), *handles)])


def urn(rng: Rng) -> Thing:
    """Draw a lidded urn on a stem and a square foot."""
    wide, tall = uniform(rng, 0.13, 0.2), uniform(rng, 0.3, 0.46)
    foot = 0.1 * tall
    points = [
        (0.75 * wide, 0),
        (0.7 * wide, foot),
        (0.2 * wide, 2 * foot),
        (0.25 * wide, 2.6 * foot),
        (0.8 * wide, 0.5 * tall),
    ]
    points += [(wide, 0.75 * tall), (0.9 * wide, 0.93 * tall), (1.05 * wide, tall), (0.9 * wide, tall)]
    dome, knob = uniform(rng, 0.3, 0.6) * wide, uniform(rng, 0.16, 0.26) * wide
    lid = [(1.0 * wide, tall), (0.98 * wide, tall + 0.1 * dome), (0.6 * wide, tall + 0.75 * dome)]
    lid += [
        (knob * 0.5, tall + dome),
        (knob, tall + dome + knob),
        (knob * 0.7, tall + dome + 1.8 * knob),
        (0.0005, tall + dome + 2.2 * knob),
    ]
    body = skin(rng)
    second = trim(rng, body)
    parts = [Part(lathe(smooth(points, 6), 72), body), Part(lathe(smooth(lid, 6), 60), second)]
    if rng.random() < 0.5:
        parts += parts_of(
            second, *(handle(0.9 * wide, 0.6 * tall, 0.85 * tall, 0.45 * wide, 0.012, a) for a in (0, 180))
        )
    return standing(parts)


def goblet(rng: Rng) -> Thing:
    """Draw a goblet: foot, stem with a knop, cup."""
    tall, cup, foot = uniform(rng, 0.26, 0.42), uniform(rng, 0.07, 0.115), uniform(rng, 0.07, 0.1)
    stem, deep, knop = uniform(rng, 0.35, 0.5) * tall, uniform(rng, 0.75, 1.1), uniform(rng, 0.018, 0.034)
    points = [
        (0.0005, 0),
        (foot, 0),
        (foot, 0.012),
        (0.4 * foot, 0.035),
        (0.013, 0.3 * stem + 0.03),
        (knop, 0.6 * stem),
    ]
    points += [
        (0.013, 0.75 * stem),
        (0.02, stem),
        (deep * cup * 0.8, stem + 0.2 * (tall - stem)),
        (cup * deep, stem + 0.5 * (tall - stem)),
    ]
    points += [
        (cup, tall),
        (cup - 0.006, tall),
        (cup * deep - 0.008, stem + 0.5 * (tall - stem)),
        (0.0005, stem + 0.02),
    ]
    body = metal(rng) if rng.random() < 0.65 else skin(rng)
    parts = [Part(lathe(smooth(points, 6), 64), body)]
    gems = [Plain(any_tone(rng, (0.4, 0.8), (0.6, 0.95)), 0.2) for _ in range(3)]
    for k, angle in enumerate(around(int(rng.integers(5, 9)))):
        at = polar(cup * deep, angle, stem + 0.5 * (tall - stem))
        parts.append(Part(ball(0.013, 0.013, 0.013, 12).moved(*at), gems[k % 3]))
    return standing(parts)


def bowl(rng: Rng) -> Thing:
    """Draw an open bowl, which may hold something."""
    wide, tall = uniform(rng, 0.16, 0.26), uniform(rng, 0.09, 0.17)
    foot, wall = uniform(rng, 0.4, 0.6) * wide, 0.01
    flare = uniform(rng, 0.75, 0.95)
    outer = [(foot, 0), (foot, 0.1 * tall), (flare * 0.8 * wide, 0.4 * tall), (flare * wide, 0.7 * tall), (wide, tall)]
    inner = [
        (wide - wall, tall),
        (flare * wide - wall, 0.7 * tall),
        (flare * 0.8 * wide - wall, 0.42 * tall),
        (0.0005, 0.2 * tall),
    ]
    half = 0.55 * flare * wide
    cavity = Cavity(half, half, 0.42 * tall, tall)
    return standing(parts_of(skin(rng), lathe(smooth([*outer, *inner], 5), 72)), cavity)


def teapot(rng: Rng) -> Thing:
    """Draw a teapot, round or tall, with spout, handle and lid."""
    wide, tall = uniform(rng, 0.12, 0.17), uniform(rng, 0.17, 0.28)
    top = uniform(rng, 0.45, 0.65) * wide
    points = [
        (0.6 * wide, 0),
        (0.62 * wide, 0.03 * tall),
        (0.95 * wide, 0.25 * tall),
        (wide, 0.48 * tall),
        (0.85 * wide, 0.78 * tall),
    ]
    points += [(top, tall), (0.0005, tall)]
    lift, knob = uniform(rng, 0.02, 0.06), uniform(rng, 0.018, 0.028)
    lid = [(top * 1.05, tall), (top, tall + 0.012), (0.5 * top, tall + lift), (0.5 * knob, tall + lift + 0.01)]
    lid += [(knob, tall + lift + knob), (0.6 * knob, tall + lift + 1.8 * knob), (0.0005, tall + lift + 2 * knob)]
    out, rise = uniform(rng, 0.55, 0.85) * wide, uniform(rng, 0.75, 1.0) * tall
    spout = limb(
        [
            (0.8 * wide, 0, 0.28 * tall),
            (wide + 0.5 * out, 0, 0.4 * tall),
            (wide + 0.75 * out, 0, 0.75 * rise),
            (wide + out, 0, rise),
        ],
        [0.3 * wide, 0.2 * wide, 0.13 * wide, 0.1 * wide],
    )
    body = skin(rng)
    second = trim(rng, body)
    bow = handle(0.92 * wide, 0.3 * tall, 0.85 * tall, uniform(rng, 0.5, 0.75) * wide, uniform(rng, 0.01, 0.015), 180)
    return standing(
        [Part(lathe(smooth(points, 6), 64), body), *parts_of(second, lathe(smooth(lid, 5), 48), spout, bow)]
    )


def pitcher(rng: Rng) -> Thing:
    """Draw a pitcher with a pouring lip and one handle."""
    tall, belly = uniform(rng, 0.28, 0.46), uniform(rng, 0.1, 0.15)
    neck = uniform(rng, 0.5, 0.75) * belly
    points = [
        (0.7 * belly, 0),
        (0.72 * belly, 0.03 * tall),
        (belly, 0.32 * tall),
        (0.9 * belly, 0.5 * tall),
        (neck, 0.76 * tall),
    ]
    points += [(1.25 * neck, 0.99 * tall), (1.2 * neck, tall), (0.85 * neck, 0.78 * tall), (0.6 * neck, 0.6 * tall)]
    pull = uniform(rng, 0.4, 0.7) * neck

    def pour(at: np.ndarray) -> np.ndarray:
        rise = np.clip((at[:, 2] - 0.8 * tall) / (0.2 * tall), 0, None)
        ahead = np.clip(at[:, 0], 0, None) / (1.25 * neck)
        moved = at.copy()
        moved[:, 0] += pull * rise * ahead**3
        moved[:, 1] *= 1 - 0.3 * np.clip(rise, 0, 1) * ahead
        moved[:, 2] += 0.12 * tall * rise * ahead**2
        return moved

    body = skin(rng)
    bow = handle(neck, 0.42 * tall, 0.93 * tall, uniform(rng, 0.6, 1.0) * belly, 0.013, 180)
    return standing([Part(lathe(smooth(points, 6), 80).bent(pour), body), Part(bow, trim(rng, body))])


def bell(rng: Rng) -> Thing:
    """Draw a large hand bell that stands on its mouth, with a wooden handle or a loop."""
    wide, tall = uniform(rng, 0.12, 0.19), uniform(rng, 0.2, 0.3)
    waist = uniform(rng, 0.5, 0.65)
    points = [
        (wide * 0.93, 0),
        (wide, 0.01),
        (0.85 * wide, 0.12 * tall),
        (waist * wide, 0.5 * tall),
        (0.5 * wide, 0.85 * tall),
    ]
    points += [(0.3 * wide, 0.98 * tall), (0.0005, tall)]
    cast = metal(rng)
    parts = [Part(lathe(smooth(points, 6), 72), cast)]
    for height in (0.14, 0.2, 0.8):
        radius = float(np.interp(height, (0, 0.12, 0.5, 0.85), (wide, 0.85 * wide, waist * wide, 0.5 * wide)))
        parts.append(Part(hoop(radius + 0.001, height * tall, 0.006), cast))
    if rng.random() < 0.6:
        long = uniform(rng, 0.14, 0.24)
        grip = [
            (0.02, 0),
            (0.016, 0.1 * long),
            (0.03, 0.5 * long),
            (0.018, 0.85 * long),
            (0.028, 0.95 * long),
            (0.0005, long),
        ]
        parts.append(Part(lathe(smooth(grip, 5), 32).moved(z=tall), wood(rng)))
    else:
        loop = [(0.05 * cos(t), 0, tall + 0.04 + 0.05 * sin(t)) for t in np.linspace(-0.7, pi + 0.7, 9)]
        parts.append(Part(limb(loop, [0.014] * 9), cast))
    return standing(parts)


def hourglass(rng: Rng) -> Thing:
    """Draw a sand glass between two discs with straight or bulged posts. Its glass belongs to it."""
    tall, wide = uniform(rng, 0.32, 0.5), uniform(rng, 0.11, 0.15)
    frame, sand = pick(rng, (wood, metal))(rng), clay(rng)
    disc = [(0.0005, 0), (wide, 0), (1.06 * wide, 0.01), (wide, 0.03), (0.0005, 0.03)]
    half = tall / 2
    bulb = [(0.5, 0.03), (0.68, 0.25 * half), (0.7, 0.5 * half), (0.4, 0.85 * half), (0.06, half)]
    points = [(r * wide, z) for r, z in bulb] + [(r * wide, tall - z) for r, z in bulb[-2::-1]]
    level = uniform(rng, 0.2, 0.5)
    heap = [
        (0.6 * wide, 0.032),
        (0.64 * wide, 0.25 * half),
        (0.5 * wide, level * half),
        (0.0005, (level + 0.25) * half),
    ]
    rest = [
        (0.05 * wide, 1.06 * half),
        (0.36 * wide, 1.16 * half),
        (0.6 * wide, (1.65 - level) * half),
        (0.0005, (1.55 - level) * half),
    ]
    parts = parts_of(frame, lathe(disc, 48), lathe(disc, 48).moved(z=tall - 0.03))
    parts += parts_of(sand, lathe(smooth(heap, 5), 40), lathe(smooth(rest, 5), 40))
    parts.append(Part(lathe(smooth(points, 6), 56), Glass(tone(uniform(rng, 90, 220), 0.12, 0.8))))
    bulge = uniform(rng, 0.008, 0.02)
    post = [
        (0.009, 0.02),
        (bulge, 0.3 * half),
        (0.009, 0.5 * half),
        (bulge, half),
        (0.009, 1.5 * half),
        (bulge, 1.7 * half),
        (0.009, tall - 0.02),
    ]
    column = lathe(smooth(post, 4), 14)
    parts += parts_of(frame, *(column.moved(*polar(0.86 * wide, a, 0)) for a in around(int(rng.integers(3, 6)))))
    return standing(parts)


def drum(rng: Rng) -> Thing:
    """Draw a drum: cylinder, barrel or goblet, with hoops and cords."""
    wide, tall, waist = uniform(rng, 0.15, 0.24), uniform(rng, 0.24, 0.5), uniform(rng, 0.7, 1.2)
    shell = decorated(rng, ("bands", "diamonds", "stripes", "checks")) if rng.random() < 0.6 else wood(rng)
    rim, hide = (
        pick(rng, (wood, metal, glaze))(rng),
        Mottled(((0.3, "#c9b48c"), (0.55, "#e6d7b4"), (0.75, "#efe5c8")), 7, 0.7),
    )
    points = [
        (wide, 0.02),
        (0.5 * (1 + waist) * wide, 0.25 * tall),
        (waist * wide, 0.5 * tall),
        (0.5 * (1 + waist) * wide, 0.75 * tall),
        (wide, tall),
    ]
    skin_top = [(wide + 0.006, tall - 0.04), (wide + 0.006, tall - 0.006), (wide - 0.01, tall), (0.0005, tall)]
    parts = [Part(lathe(smooth(points, 6), 72), shell), Part(lathe(skin_top, 64), hide)]
    thick = uniform(rng, 0.012, 0.018)
    parts += parts_of(rim, hoop(wide + 0.008, tall - 0.04, thick), hoop(wide + 0.008, thick, thick))
    count, cord = 2 * int(rng.integers(5, 10)), cloth(rng)
    reach = wide * max(waist, 1.0) + 0.015
    for k, angle in enumerate(around(count)):
        ends = (0.03, tall - 0.05) if k % 2 else (tall - 0.05, 0.03)
        path = [
            polar(reach, angle + 2 * pi / count * t, ends[0] + (ends[1] - ends[0]) * t) for t in (0, 0.25, 0.5, 0.75, 1)
        ]
        parts.append(Part(limb(path, [0.005] * 5, 6), cord))
    return standing(parts)


def barrel(rng: Rng) -> Thing:
    """Draw a barrel of staves with iron hoops."""
    wide, tall, end = uniform(rng, 0.2, 0.3), uniform(rng, 0.45, 0.75), uniform(rng, 0.76, 0.86)
    oak, iron = wood(rng), darker(metal(rng), 0.6)
    points = [
        (end * wide, 0),
        (0.94 * wide, 0.25 * tall),
        (wide, 0.5 * tall),
        (0.94 * wide, 0.75 * tall),
        (end * wide, tall),
    ]
    points += [(end * wide - 0.02, tall), (end * wide - 0.025, tall - 0.03), (0.0005, tall - 0.03)]
    count = int(rng.integers(14, 22))

    def staves(at: np.ndarray) -> np.ndarray:
        turn = np.arctan2(at[:, 1], at[:, 0])
        groove = 1 - 0.02 * (np.abs((turn * count / (2 * pi)) % 1 - 0.5) > 0.42)
        return at * np.stack([groove, groove, np.ones(len(at))], axis=1)

    parts = [Part(lathe(np.vstack([smooth(points[:5], 6), points[5:]]), 8 * count).bent(staves), oak)]
    for height in (0.04, 0.2, 0.8, 0.96):
        radius = wide * float(np.interp(height, (0, 0.25, 0.5, 0.75, 1), (end, 0.94, 1, 0.94, end)))
        band = [(radius - 0.002, height * tall - 0.018), (radius + 0.005, height * tall - 0.016)]
        parts.append(
            Part(
                lathe([*band, (radius + 0.005, height * tall + 0.016), (radius - 0.002, height * tall + 0.018)], 64),
                iron,
            )
        )
    return standing(parts)


def flowerpot(rng: Rng) -> Thing:
    """Draw a pot with a plant: leaves as blades, and flowers on some."""
    wide, tall = uniform(rng, 0.11, 0.17), uniform(rng, 0.15, 0.24)
    pot = [
        (0.7 * wide, 0),
        (0.72 * wide, 0.01),
        (0.95 * wide, 0.8 * tall),
        (1.08 * wide, 0.82 * tall),
        (1.1 * wide, tall),
        (0.95 * wide, tall),
    ]
    pot += [(0.9 * wide, 0.85 * tall)]
    soil = Mottled(((0.3, "#1e140d"), (0.7, "#47321f")), 60, 0.95, bump=0.8)
    parts = [Part(lathe(pot, 56), clay(rng) if rng.random() < 0.5 else skin(rng))]
    parts.append(Part(lathe([(0.93 * wide, 0.88 * tall), (0.0005, 0.92 * tall)], 32), soil))
    hue = uniform(rng, 75, 140)
    leaf = Mottled(
        ((0.3, tone(hue, 0.6, 0.3)), (0.55, tone(hue, 0.6, 0.45)), (0.75, tone(hue - 15, 0.5, 0.6))), 30, 0.5
    )
    reach, width, upright = uniform(rng, 0.2, 0.34), uniform(rng, 0.02, 0.045), uniform(rng, 0.5, 1.2)
    for k in range(int(rng.integers(26, 46))):
        angle, lean = k * 2.39996, 0.1 + upright * (k / 40) ** 0.8
        long = reach * uniform(rng, 0.75, 1.1)
        path, side = [], np.array([-sin(angle), cos(angle), 0.0])
        for t in np.linspace(0, 1, 7):
            bend = lean * (0.6 + 0.8 * t)
            path.append(
                np.array(
                    [
                        long * t * sin(bend) * cos(angle),
                        long * t * sin(bend) * sin(angle),
                        0.9 * tall + long * t * cos(bend),
                    ]
                )
            )
        rows = []
        for t, at in zip(np.linspace(0, 1, 7), path, strict=True):
            half = width * sin(pi * (0.08 + 0.92 * t) ** 0.8) + 0.002
            rows.append(
                [
                    at - side * half,
                    at + np.array([0, 0, -0.15 * half]),
                    at + side * half,
                    at + np.array([0, 0, 0.05 * half]),
                ]
            )
        parts.append(Part(loft(rows), leaf))
    flower = Plain(any_tone(rng, (0.7, 0.95), (0.5, 0.9)), 0.6)
    for _ in range(int(rng.integers(0, 8))):
        angle, lean, long = uniform(rng, 0, 2 * pi), uniform(rng, 0, 0.5), reach * uniform(rng, 0.9, 1.2)
        top = (long * sin(lean) * cos(angle), long * sin(lean) * sin(angle), 0.9 * tall + long * cos(lean))
        parts.append(Part(rod((0, 0, 0.9 * tall), top, 0.004, 6), leaf))
        parts += parts_of(
            flower,
            *(
                ball(0.022, 0.022, 0.014, 10).moved(*(np.array(top) + 0.024 * np.array(polar(1, a, 0))).tolist())
                for a in around(6)
            ),
        )
    return standing(parts)
