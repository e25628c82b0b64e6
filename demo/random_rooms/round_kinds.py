# SPDX-License-Identifier: GPL-3.0-or-later
"""Round exhibits: bucket, lamp, globe, crown, helmet, wheel; and glass: bottle, jar, dome."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
from studio.shapes import Shape, ball, box, lathe, ring, smooth, tube

from .stuffs import (
    Glass,
    Mottled,
    Painted,
    Plain,
    Rng,
    any_tone,
    clay,
    cloth,
    darker,
    decorated,
    glaze,
    hard,
    ink,
    metal,
    new_seed,
    pick,
    stone,
    tone,
    uniform,
    wood,
)
from .things import Cavity, Part, Thing, around, hoop, limb, parts_of, polar, rod, standing


def bucket(rng: Rng) -> Thing:
    """Draw a bucket with a bail, which may hold something."""
    wide, tall, foot = uniform(rng, 0.13, 0.18), uniform(rng, 0.2, 0.3), uniform(rng, 0.7, 0.85)
    body = pick(rng, (metal, wood, glaze))(rng)
    wall = [(0.0005, 0), (foot * wide, 0), (foot * wide, 0.004), (wide, tall), (wide - 0.007, tall)]
    wall += [(foot * wide, 0.03), (0.0005, 0.03)]
    parts = [Part(lathe(wall, 64), body)]
    second = metal(rng)
    for height in (0.12, 0.5, 0.97):
        parts.append(Part(hoop((foot + (1 - foot) * height) * wide + 0.002, height * tall, 0.006), second))
    lean = uniform(rng, -1.0, 1.0)
    bail = [
        (wide * cos(a), 0.9 * wide * sin(a) * sin(lean), tall + 0.9 * wide * sin(a) * cos(lean))
        for a in np.linspace(0, pi, 11).tolist()
    ]
    parts.append(Part(limb(bail, [0.006] * 11, 8), second))
    half = 0.62 * foot * wide
    return standing(parts, Cavity(half, half, 0.03, tall))


def lamp(rng: Rng) -> Thing:
    """Draw a table lamp: foot, stem and a shade of cloth or glass."""
    tall, shade_wide = uniform(rng, 0.42, 0.62), uniform(rng, 0.13, 0.2)
    foot, belly, shade = uniform(rng, 0.07, 0.11), uniform(rng, 0.02, 0.1), uniform(rng, 0.3, 0.42) * tall
    low = tall - shade
    profile = [(0.0005, 0), (foot, 0), (foot, 0.014), (0.5 * foot, 0.04), (belly, 0.45 * low), (0.018, 0.85 * low)]
    profile += [(0.012, low), (0.01, low + 0.3 * shade), (0.0005, low + 0.3 * shade)]
    top = uniform(rng, 0.35, 0.85) * shade_wide
    middle = 0.5 * (top + shade_wide) * uniform(rng, 0.95, 1.15)
    curve = smooth([(shade_wide, low), (middle, low + 0.5 * shade), (top, tall)], 6)
    inner = (curve * [0.97, 1.0])[::-1]
    cover = decorated(rng, ("stripes", "floral", "diamonds", "bands"), (256, 512)) if rng.random() < 0.6 else cloth(rng)
    spokes = [rod((0, 0, low + 0.3 * shade), polar(0.97 * middle, a, low + 0.5 * shade), 0.003) for a in around(3)]
    body = pick(rng, (metal, wood, glaze, clay))(rng)
    return standing([*parts_of(body, lathe(smooth(profile, 6), 56), *spokes), Part(lathe([*curve, *inner], 64), cover)])


def globe(rng: Rng) -> Thing:
    """Draw a globe on a stand with a meridian ring."""
    radius, base = uniform(rng, 0.13, 0.2), uniform(rng, 0.09, 0.2)
    sea = tone(uniform(rng, 190, 230), uniform(rng, 0.15, 0.5), uniform(rng, 0.55, 0.85))
    if rng.random() < 0.4:
        sea = tone(uniform(rng, 36, 46), uniform(rng, 0.25, 0.4), 0.85)
    lands = tuple(tone(uniform(rng, 20, 120), uniform(rng, 0.3, 0.6), uniform(rng, 0.4, 0.75)) for _ in range(3))
    map_of = Painted("globe", (sea, "#4a3a2c", *lands), new_seed(rng), (512, 1024), 0.4, wear=0.15)
    tilt, centre = uniform(rng, 10, 30), base + radius + 0.03
    sphere = ball(radius, radius, radius, 64).turned("y", tilt).moved(z=centre)
    brass = metal(rng)
    meridian = ring(radius + 0.012, 0.006, 64).turned("x", 90).moved(z=centre)
    foot_wide = uniform(rng, 0.09, 0.13)
    foot = [
        (0.0005, 0),
        (foot_wide, 0),
        (foot_wide, 0.015),
        (0.035, 0.035),
        (0.02, 0.5 * base),
        (0.03, base),
        (0.01, base + 0.02),
    ]
    parts = [Part(sphere, map_of), *parts_of(brass, meridian), Part(lathe(smooth(foot, 6), 48), wood(rng))]
    if rng.random() < 0.5:
        parts.append(Part(ring(radius + 0.014, 0.009, 64).moved(z=centre), wood(rng)))
    return standing(parts)


def crown(rng: Rng) -> Thing:
    """Draw a crown on a cushion: a band with points or arches, and gems."""
    wide, tall, count = uniform(rng, 0.11, 0.14), uniform(rng, 0.1, 0.17), int(rng.integers(5, 9))
    gold, gems = metal(rng), [Plain(any_tone(rng, (0.4, 0.8), (0.7, 0.95)), 0.15) for _ in range(3)]
    pillow = ball(1.7 * wide, 1.7 * wide, 0.06, 40).moved(z=0.06)
    low, flare = 0.095, uniform(rng, 1.0, 1.15)
    band = [(wide, low), (wide + 0.006, low), (wide + 0.006, low + 0.04), (wide, low + 0.04)]
    parts = [
        Part(pillow, cloth(rng)),
        *parts_of(gold, lathe(band, 64), hoop(wide + 0.004, low, 0.007), hoop(wide + 0.004, low + 0.04, 0.006)),
    ]
    arches = rng.random() < 0.4
    for k, angle in enumerate(around(count)):
        tip = polar(flare * wide, angle, low + tall)
        if arches:
            path = [
                polar(wide, angle, low + 0.04),
                polar(1.1 * wide, angle, low + 0.6 * tall),
                polar(0.6 * wide, angle, low + 1.15 * tall),
            ]
            parts.append(Part(limb([*path, (0, 0, low + 1.05 * tall)], [0.008] * 4, 8), gold))
        else:
            for side in (-0.45, 0.45):
                start = polar(wide, angle + side * 2 * pi / count, low + 0.04)
                parts.append(Part(rod(start, tip, 0.007), gold))
            parts.append(Part(ball(0.014, 0.014, 0.014, 12).moved(*tip), gems[k % 3]))
        parts.append(
            Part(ball(0.012, 0.012, 0.012, 12).moved(*polar(wide + 0.008, angle, low + 0.02)), gems[(k + 1) % 3])
        )
    if arches:
        parts.append(Part(ball(0.024, 0.024, 0.024, 16).moved(z=low + 1.05 * tall + 0.02), gold))
    return standing(parts)


def helmet(rng: Rng) -> Thing:
    """Draw an ancient or a medieval helmet on a post: dome, brow, cheeks and a crest or a spike."""
    wide, tall = uniform(rng, 0.11, 0.13), uniform(rng, 0.15, 0.2)
    iron, post = metal(rng), wood(rng)
    point = uniform(rng, 0.75, 1.3)
    dome = [
        (wide, 0),
        (wide * 1.02, 0.02),
        (wide, 0.3 * tall),
        (0.8 * wide, 0.65 * tall),
        (0.4 * wide, 0.9 * tall * point),
        (0.0005, tall * point),
    ]
    lift = uniform(rng, 0.2, 0.3)
    parts = parts_of(iron, lathe(smooth(dome, 6), 56).scaled(1, 1.18, 1).moved(z=lift))
    parts.append(Part(ring(wide * 1.02, 0.009, 56).scaled(1, 1.18, 1).moved(z=lift), darker(iron, 0.7)))
    drop = uniform(rng, 0.1, 0.16)
    for side in (-1, 1):
        cheek = [
            (side * wide * 0.95, -0.05, lift),
            (side * wide * 0.9, -0.08, lift - 0.6 * drop),
            (side * wide * 0.6, -0.1, lift - drop),
        ]
        parts.append(Part(limb(cheek, [0.03, 0.036, 0.012], 12, 0.25), iron))
    parts.append(
        Part(
            limb(
                [(0, -1.2 * wide, lift + 0.03), (0, -1.25 * wide, lift - 0.03), (0, -1.22 * wide, lift - 0.5 * drop)],
                [0.012, 0.012, 0.008],
                8,
            ),
            iron,
        )
    )
    crest = rng.random()
    if crest < 0.5:
        plume = cloth(rng)
        arc = [
            (0, -1.0 * wide * cos(a) * 1.25, lift + 0.02 + tall * point * 1.06 * sin(a))
            for a in np.linspace(0.5, pi - 0.1, 8).tolist()
        ]
        parts.append(Part(limb(arc, [0.015, 0.03, 0.036, 0.04, 0.04, 0.036, 0.03, 0.012], 12, 0.5), plume))
    elif crest < 0.8:
        parts.append(
            Part(lathe([(0.02, 0), (0.008, 0.03), (0.0005, 0.1)], 16).moved(z=lift + tall * point - 0.005), iron)
        )
    parts += parts_of(post, lathe([(0.0005, 0), (0.1, 0), (0.095, 0.02), (0.02, 0.03), (0.02, lift + 0.5 * tall)], 32))
    return standing(parts)


def wheel(rng: Rng) -> Thing:
    """Draw a spoked wheel of a cart, which stands in a chock."""
    radius, spokes, thick = uniform(rng, 0.26, 0.42), int(rng.integers(6, 13)), uniform(rng, 0.018, 0.028)
    timber, iron = wood(rng), darker(metal(rng), 0.7)
    hub = [(0.0005, -0.07), (0.035, -0.07), (0.055, 0), (0.035, 0.07), (0.0005, 0.07)]
    shapes = [ring(radius - thick, thick, 64, 12).scaled(1, 1, 1.3), lathe(smooth(hub, 4), 24)]
    shapes += [rod(polar(0.04, a, 0), polar(radius - thick, a, 0), 0.013) for a in around(spokes)]
    tyre = lathe(
        [
            (radius - 0.004, -1.1 * thick),
            (radius + 0.005, -thick),
            (radius + 0.005, thick),
            (radius - 0.004, 1.1 * thick),
        ],
        64,
    )
    up = uniform(rng, 0, 30)
    parts = [Part(shape.turned("z", up).turned("x", 90).moved(z=radius + 0.02), timber) for shape in shapes]
    parts.append(Part(tyre.turned("x", 90).moved(z=radius + 0.02), iron))
    for side in (-1, 1):
        parts.append(Part(box(0.1, 0.16, 0.07).moved(x=side * 0.5 * radius), timber))
    parts.append(Part(box(1.2 * radius, 0.12, 0.025), timber))
    return standing(parts)


def bottle(rng: Rng) -> Thing:
    """Draw a tall bottle of coloured glass or a glazed one, with a stopper and often a label."""
    wide, tall = uniform(rng, 0.045, 0.075), uniform(rng, 0.32, 0.46)
    shoulder = uniform(rng, 0.5, 0.68) * tall
    neck = uniform(rng, 0.28, 0.4) * wide
    points = [
        (0.0005, 0),
        (0.9 * wide, 0),
        (wide, 0.02),
        (wide, 0.5 * shoulder),
        (wide, shoulder),
        (0.8 * wide, shoulder + 0.06 * tall),
    ]
    points += [(neck, shoulder + 0.16 * tall), (neck, 0.96 * tall), (neck * 1.25, 0.97 * tall), (neck * 1.2, tall)]
    hue = uniform(rng, 60, 240)
    filled = Mottled(((0.3, tone(hue, 0.6, 0.16)), (0.7, tone(hue, 0.6, 0.34))), 12, 0.2, speckle=0.15)
    body = filled if rng.random() < 0.5 else Glass(tone(hue, 0.4, 0.6), uniform(rng, 0.3, 0.5))
    parts = [Part(lathe(smooth(points, 6), 48), body)]
    if isinstance(body, Glass):
        level = uniform(rng, 0.4, 0.95) * shoulder
        liquid = [(0.0005, 0.012), (0.88 * wide, 0.015), (0.92 * wide, level), (0.0005, level)]
        parts.append(Part(lathe(liquid, 40), replace(filled, stops=((0.3, any_tone(rng)), (0.7, any_tone(rng))))))
    if rng.random() < 0.75:
        colours = ("#efe6d0", "#2a1c12", any_tone(rng), any_tone(rng))
        label = [(wide + 0.0015, 0.25 * shoulder), (wide + 0.0015, 0.85 * shoulder)]
        parts.append(
            Part(lathe(label, 40), Painted(pick(rng, ("cover", "bands", "floral")), colours, new_seed(rng), (256, 512)))
        )
    cork = [(0.7 * neck, 0.98 * tall), (0.9 * neck, tall + 0.02), (0.8 * neck, tall + 0.035), (0.0005, tall + 0.035)]
    parts.append(Part(lathe(cork, 24), pick(rng, (wood, glaze))(rng)))
    return standing(parts)


def jar(rng: Rng) -> Thing:
    """Draw a storage jar of clear glass with a lid, filled with balls."""
    wide, tall = uniform(rng, 0.09, 0.14), uniform(rng, 0.2, 0.32)
    points = [
        (0.9 * wide, 0.004),
        (wide, 0.03),
        (wide, 0.5 * tall),
        (wide, 0.84 * tall),
        (0.8 * wide, 0.94 * tall),
        (0.8 * wide, tall),
    ]
    parts = [Part(lathe(smooth(points, 5), 56), Glass(tone(uniform(rng, 90, 220), 0.15, 0.8)))]
    fills = [glaze(rng) for _ in range(3)]
    size, level = uniform(rng, 0.022, 0.034), uniform(rng, 0.5, 0.8) * tall
    z, row = size + 0.005, 0
    while z < level:
        # Rings of balls inside the wall hide the middle.
        reach = 0.94 * wide - size
        count = int(2 * pi * reach / (2.05 * size))
        for k, angle in enumerate(around(count, 0.5 * row)):
            parts.append(
                Part(ball(size, size, size, 12).moved(*polar(reach, angle, z)), fills[(k * 7 + row * 3) % 5 % 3])
            )
        parts.append(Part(lathe([(reach, z), (0.0005, z)], 16), fills[row % 3]))
        z, row = z + 1.75 * size, row + 1
    parts.append(Part(lathe([(0.88 * wide, 0), (0.0005, 0.002)], 32), fills[0]))
    lid = [
        (0.86 * wide, tall),
        (0.88 * wide, tall + 0.012),
        (0.6 * wide, tall + 0.03),
        (0.02, tall + 0.034),
        (0.024, tall + 0.06),
        (0.0005, tall + 0.065),
    ]
    parts.append(Part(lathe(smooth(lid, 4), 40), pick(rng, (metal, wood, glaze))(rng)))
    return standing(parts)


def dome(rng: Rng) -> Thing:
    """Draw a glass dome on a wooden base with a branch, a bird or minerals below it. The glass belongs to it."""
    wide, tall = uniform(rng, 0.12, 0.16), uniform(rng, 0.3, 0.46)
    base = [(0.0005, 0), (1.2 * wide, 0), (1.22 * wide, 0.015), (1.1 * wide, 0.03), (1.08 * wide, 0.04), (0.0005, 0.04)]
    cover = [(wide, 0.04), (wide, 0.4 * tall), (wide, 0.72 * tall), (0.75 * wide, 0.92 * tall), (0.0005, tall)]
    parts = [
        Part(lathe(base, 56), wood(rng)),
        Part(lathe(smooth(cover, 6), 56), Glass(tone(uniform(rng, 120, 210), 0.1, 0.85), 0.04)),
    ]
    if rng.random() < 0.5:
        bark = wood(rng)
        top = 0.5 * tall
        parts.append(
            Part(
                limb(
                    [(0, 0, 0.04), (0.02, 0, 0.3 * tall), (-0.02, 0.01, top), (0.03, 0, top + 0.04)],
                    [0.016, 0.012, 0.01, 0.006],
                    8,
                ),
                bark,
            )
        )
        parts += parts_of(glaze(rng), *bird(0.55 * wide, (0.0, 0.0, top + 0.035)))
    else:
        rock = stone(rng)
        for k in range(7):
            angle, reach = 2.4 * k, 0.5 * wide * (k > 0)
            high = uniform(rng, 0.25, 0.55) * tall * (1.2 if k == 0 else 0.8)
            half = uniform(rng, 0.2, 0.32) * wide
            crystal = lathe([(half, 0), (half, 0.75 * high), (0.0005, high)], 6).turned("x", uniform(rng, -10, 10))
            parts.append(Part(replace(crystal.moved(*polar(reach, angle, 0.04)), crease=20.0), rock))
    return standing(parts)


def bird(long: float, at: tuple[float, float, float]) -> list[Shape]:
    """Return the body, head, beak and tail of a sitting bird."""
    body = ball(long, 0.5 * long, 0.55 * long, 28).turned("y", -25)
    head = ball(0.36 * long, 0.33 * long, 0.33 * long, 20).moved(0.75 * long, 0, 0.6 * long)
    beak = tube(
        [(1.0 * long, 0, 0.6 * long), (1.2 * long, 0, 0.56 * long), (1.4 * long, 0, 0.52 * long)],
        [0.1 * long, 0.06 * long, 0.01 * long],
        8,
    )
    tail = limb(
        [(-0.7 * long, 0, -0.2 * long), (-1.3 * long, 0, -0.5 * long), (-1.7 * long, 0, -0.7 * long)],
        [0.2 * long, 0.16 * long, 0.1 * long],
        10,
        0.4,
    )
    legs = [
        rod((0.1 * long, s * 0.2 * long, -0.4 * long), (0.1 * long, s * 0.2 * long, -0.7 * long), 0.05 * long, 6)
        for s in (-1, 1)
    ]
    return [shape.moved(*at) for shape in (body, head, beak, tail, *legs)]


def toy_ball(rng: Rng) -> Thing:
    """Draw a large ball with painted panels on a ring."""
    radius = uniform(rng, 0.13, 0.19)
    pattern = Painted(pick(rng, ("diamonds", "checks", "stripes", "blobs")), ink(rng), new_seed(rng), (512, 1024), 0.45)
    sphere = ball(radius, radius, radius, 56).turned("x", uniform(rng, -60, 60)).turned("y", uniform(rng, -60, 60))
    stand = ring(0.45 * radius, 0.1 * radius, 40)
    return standing([Part(sphere.moved(z=radius), pattern), Part(stand.moved(z=0.1 * radius), hard(rng))])
