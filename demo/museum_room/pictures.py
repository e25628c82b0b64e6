# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural textures of the museum room, as uint8 sRGB arrays of shape (h, w, 3)."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin

import numpy as np
from PIL import Image, ImageDraw
from studio.textures import noise, shade


def warrior(
    draw: ImageDraw.ImageDraw, x: float, foot: float, h: float, direction: int, fill: str, cut: str
) -> None:
    """Draw a black-figure hoplite of height h standing at x, walking in x `direction` (-1 or 1)."""

    def at(dx: float, dy: float) -> tuple[float, float]:
        return x + direction * dx * h, foot - dy * h

    def limb(points: Sequence[tuple[float, float]], width: float, colour: str = fill) -> None:
        draw.line([at(*p) for p in points], fill=colour, width=max(2, int(width * h)), joint="curve")

    def disc(dx: float, dy: float, r: float, colour: str) -> None:
        cx, cy = at(dx, dy)
        draw.ellipse([cx - r * h, cy - r * h, cx + r * h, cy + r * h], fill=colour)

    limb([(0.02, 0.46), (0.16, 0.26), (0.12, 0.02), (0.22, 0.02)], 0.075)
    limb([(-0.02, 0.46), (-0.12, 0.25), (-0.26, 0.03), (-0.17, 0.02)], 0.075)
    draw.polygon([at(-0.11, 0.42), at(0.11, 0.42), at(0.13, 0.74), at(-0.13, 0.74)], fill=fill)
    limb([(-0.1, 0.72), (-0.22, 0.6), (-0.1, 0.56)], 0.055)
    disc(0.02, 0.83, 0.075, fill)
    draw.polygon([at(-0.14, 0.86), at(-0.02, 0.99), at(0.1, 0.93), at(0.02, 0.88)], fill=fill)
    limb([(0.0, 0.82), (0.09, 0.8)], 0.015, cut)
    disc(0.12, 0.58, 0.17, cut)
    disc(0.12, 0.58, 0.155, fill)
    disc(0.12, 0.58, 0.10, cut)
    for k in range(3):
        angle = 2 * pi * k / 3 + 0.4
        limb([(0.12, 0.58), (0.12 + 0.1 * cos(angle), 0.58 + 0.1 * sin(angle))], 0.035)
    limb([(-0.36, 0.5), (0.42, 0.78)], 0.016)
    for dx in (-0.07, 0.0, 0.07):
        limb([(dx, 0.43), (dx, 0.36)], 0.05)


def amphora() -> np.ndarray:
    """Paint the bands of a Greek amphora, black on orange, from foot (bottom) to lip."""
    width, height = 2048, 1100
    orange, black = "#cf7a3c", "#1d1512"
    picture = Image.new("RGB", (width, height), orange)
    draw = ImageDraw.Draw(picture)

    def y(v: float) -> float:
        return (1 - v) * height

    def band(low: float, high: float) -> None:
        draw.rectangle([0, y(high), width, y(low)], fill=black)

    band(0.0, 0.09)
    rays = 28
    for k in range(rays):
        x0, step = k * width / rays, width / rays
        draw.polygon([(x0 + 4, y(0.1)), (x0 + step - 4, y(0.1)), (x0 + step / 2, y(0.24))], fill=black)
    band(0.25, 0.275)
    band(0.29, 0.30)
    figures = 10
    for k in range(figures):
        warrior(
            draw, (k + 0.5) * width / figures, y(0.315), 0.235 * height, 1 if k % 2 else -1, black, orange
        )
    band(0.56, 0.57)
    key = (0.0, 0.0), (0.0, 1.0), (0.8, 1.0), (0.8, 0.3), (0.4, 0.3), (0.4, 0.62), (0.55, 0.62)
    for k in range(36):
        x0, size = k * width / 36, width / 36
        draw.line([(x0 + a * size, y(0.58 + b * 0.045)) for a, b in key], fill=black, width=8)
        draw.line([(x0, y(0.58)), (x0 + size, y(0.58))], fill=black, width=8)
    band(0.635, 0.645)
    for k in range(48):
        x0, step = k * width / 48, width / 48
        draw.rounded_rectangle([x0 + 5, y(0.7), x0 + step - 5, y(0.652)], 14, fill=black)
    band(0.705, 0.725)
    for k in range(20):
        x0, step = (k + 0.5) * width / 20, width / 40
        for dx in (-0.8, -0.4, 0, 0.4, 0.8):
            tip = (x0 + dx * step, y(0.86 - 0.05 * abs(dx)))
            draw.line([(x0, y(0.75)), tip], fill=black, width=11)
            draw.ellipse([tip[0] - 9, tip[1] - 9, tip[0] + 9, tip[1] + 9], fill=black)
        draw.arc([x0 - step, y(0.79), x0 + step, y(0.73)], 0, 180, fill=black, width=7)
    band(0.885, 1.0)
    return shade(picture, 8, 0.5, 1)


def porcelain() -> np.ndarray:
    """Paint blue flowers and leaves on white, with border bands."""
    width, height = 1600, 800
    rng = np.random.default_rng(5)
    picture = Image.new("RGB", (width, height), "#f1efe6")
    draw = ImageDraw.Draw(picture)
    blues = ("#1f3f94", "#2d57b4", "#16306f")
    for x0 in np.arange(60, width, 200):
        middle = height * rng.uniform(0.42, 0.6)
        stem = [(x0 + 60 * sin(t * 3), middle + 260 * (t - 0.5)) for t in np.linspace(0, 1, 30)]
        draw.line(stem, fill=blues[2], width=7)
        for x, y in stem[2::4]:
            for side in (-1, 1):
                length, drop = rng.uniform(28, 50), rng.uniform(-22, 22)
                tip = (x + side * length, y + drop)
                draw.polygon(
                    [
                        (x, y),
                        (x + side * length / 2, y + drop - 13),
                        tip,
                        (x + side * length / 2, y + drop + 13),
                    ],
                    fill=blues[rng.integers(3)],
                )
        for x, y in (stem[6], stem[24]):
            petals = rng.integers(5, 9)
            for k in range(petals):
                angle = 2 * pi * k / petals
                px, py = x + 30 * cos(angle), y + 30 * sin(angle)
                draw.ellipse(
                    [px - 19, py - 19, px + 19, py + 19], fill=blues[k % 2], outline="#f1efe6", width=3
                )
            draw.ellipse([x - 14, y - 14, x + 14, y + 14], fill="#e0b64a")
    for top in (0.06, 0.9):
        draw.rectangle([0, top * height, width, (top + 0.045) * height], fill=blues[0])
        for k in range(60):
            x0 = k * width / 60
            draw.ellipse([x0 + 4, top * height + 8, x0 + 20, top * height + 26], fill="#f1efe6")
    return shade(picture, 6, 0.16, 2)


def hieroglyphs(width: int, height: int, seed: int) -> np.ndarray:
    """Paint one face of an obelisk: a framed column of carved signs on sandstone."""
    rng = np.random.default_rng(seed)
    grain = noise(height, width, 8, 7, seed + 50)
    stone = np.array([201, 168, 122]) * (0.72 + 0.5 * grain[..., None])
    picture = Image.fromarray(np.clip(stone, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    ink = "#5a4028"
    draw.rectangle([width * 0.12, 6, width * 0.88, height - 6], outline=ink, width=7)
    cell = width * 0.34
    y, last = cell * 0.5, -1
    while y < height - cell * 0.9:
        for x in (width * 0.31, width * 0.69):
            sign = int(rng.choice([s for s in range(8) if s != last]))
            glyph(draw, sign, x, y + cell * 0.3, cell * 0.72, ink)
            last = sign
        y += cell * 0.95
    return np.asarray(picture)


def glyph(draw: ImageDraw.ImageDraw, sign: int, x: float, y: float, s: float, ink: str) -> None:
    """Draw one made-up hieroglyph of size s centred at (x, y)."""
    w = max(3, int(s * 0.1))

    def line(*points: tuple[float, float]) -> None:
        draw.line([(x + a * s, y + b * s) for a, b in points], fill=ink, width=w, joint="curve")

    def oval(a: float, b: float, c: float, d: float, solid: bool = False) -> None:
        extent = [x + a * s, y + b * s, x + c * s, y + d * s]
        draw.ellipse(extent, outline=ink, width=w, fill=ink if solid else None)

    if sign == 0:  # ankh
        oval(-0.17, -0.5, 0.17, -0.08)
        line((0, -0.08), (0, 0.5))
        line((-0.3, 0.08), (0.3, 0.08))
    elif sign == 1:  # water
        for b in (-0.25, 0.0, 0.25):
            line(*[(-0.45 + 0.15 * k, b + (0.08 if k % 2 else -0.08)) for k in range(7)])
    elif sign == 2:  # eye
        oval(-0.42, -0.2, 0.42, 0.15)
        oval(-0.12, -0.14, 0.12, 0.1, solid=True)
        line((0.1, 0.15), (0.15, 0.42))
        line((-0.45, -0.32), (0.42, -0.34))
    elif sign == 3:  # bird
        oval(-0.3, -0.12, 0.25, 0.25, solid=True)
        oval(-0.42, -0.4, -0.12, -0.1, solid=True)
        line((-0.4, -0.25), (-0.5, -0.18))
        line((0.2, 0.1), (0.48, 0.3))
        line((-0.08, 0.2), (-0.08, 0.48), (-0.22, 0.48))
    elif sign == 4:  # sun
        oval(-0.3, -0.3, 0.3, 0.3)
        oval(-0.08, -0.08, 0.08, 0.08, solid=True)
    elif sign == 5:  # reeds
        for a in (-0.25, 0.15):
            line((a, 0.48), (a, -0.2))
            oval(a - 0.08, -0.5, a + 0.12, 0.1, solid=True)
    elif sign == 6:  # snake
        line(*[(-0.45 + 0.09 * k, 0.15 * sin(k * 1.3)) for k in range(10)], (0.45, -0.3))
    else:  # house
        line((-0.35, 0.3), (-0.35, -0.3), (0.35, -0.3), (0.35, 0.3), (0.12, 0.3))


def sunburst() -> np.ndarray:
    """Paint a round shield seen from the front: rings, a sixteen-rayed star, a key band, verdigris."""
    size = 1024
    grain = noise(size, size, 6, 7, 11)
    bronze, green = np.array([164, 112, 52]), np.array([84, 122, 98])
    patina = np.clip((grain - 0.56) * 5, 0, 0.8)[..., None]
    base = (bronze * (1 - patina) + green * patina) * (0.7 + 0.6 * grain[..., None])
    picture = Image.fromarray(np.clip(base, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    dark, light, c = "#3a2612", "#e0b566", size / 2

    def ring(r: float, width: int, colour: str) -> None:
        draw.ellipse([c - r * c, c - r * c, c + r * c, c + r * c], outline=colour, width=width)

    for r, width, colour in (
        (0.985, 16, light),
        (0.94, 8, dark),
        (0.8, 8, dark),
        (0.78, 6, light),
        (0.27, 10, dark),
    ):
        ring(r, width, colour)
    for k in range(40):
        a, b = 2 * pi * k / 40, 2 * pi * (k + 0.6) / 40
        corners = [(0.82, a), (0.91, a), (0.91, b), (0.85, b), (0.85, a + (b - a) * 0.4)]
        draw.line([(c + r * c * cos(t), c + r * c * sin(t)) for r, t in corners], fill=dark, width=7)
    for k in range(16):
        a = 2 * pi * k / 16
        tip, reach = 0.74 if k % 2 else 0.6, 2 * pi / 44
        for side, colour in ((-1, dark), (1, light)):
            points = [(0.3, a), (0.3, a + side * reach * 1.5), (tip, a)]
            draw.polygon([(c + r * c * cos(t), c + r * c * sin(t)) for r, t in points], fill=colour)
    return np.asarray(picture)


def face() -> np.ndarray:
    """Paint a theatre mask seen from the front, in the square -1..1 of the relief."""
    size = 1024
    grain = noise(size, size, 6, 7, 21)
    skin = np.array([222, 190, 148]) * (0.82 + 0.3 * grain[..., None])
    picture = Image.fromarray(np.clip(skin, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(picture, "RGBA")

    def at(x: float, z: float) -> tuple[float, float]:
        return (x + 1) / 2 * size, (1 - z) / 2 * size

    def oval(x: float, z: float, rx: float, rz: float, fill: str | tuple[int, ...]) -> None:
        draw.ellipse([*at(x - rx, z + rz), *at(x + rx, z - rz)], fill=fill)

    for side in (-1, 1):
        for k in range(10):
            oval(side * 0.5, -0.22, 0.24 - 0.02 * k, 0.2 - 0.016 * k, (190, 60, 40, 22))
        oval(side * 0.37, 0.15, 0.27, 0.145, "#2a1a14")
        oval(side * 0.37, 0.15, 0.24, 0.115, "#e8d9b4")
        brow = [at(side * (0.12 + 0.05 * k), 0.36 + 0.13 * sin(pi * (k + 1) / 12)) for k in range(11)]
        draw.line(brow, fill="#2a1a14", width=34, joint="curve")
        for k in range(3):
            draw.line(
                [at(side * (0.62 + 0.07 * k), 0.0), at(side * (0.58 + 0.07 * k), -0.42)],
                fill="#2f5f8a",
                width=16,
            )
    lips = [
        at(0.44 * cos(t), -0.52 + (0.15 if sin(t) > 0 else 0.19) * sin(t)) for t in np.linspace(0, 2 * pi, 60)
    ]
    draw.polygon(lips, fill="#a3261c")
    draw.rectangle([*at(-1, 1), *at(1, 0.66)], fill="#7c1f1a")
    for z in (0.66, 0.9):
        draw.rectangle([*at(-1, z + 0.025), *at(1, z - 0.025)], fill="#d9a93c")
    for k in range(13):
        x = -0.9 + 0.15 * k
        draw.polygon([at(x - 0.06, 0.78), at(x, 0.87), at(x + 0.06, 0.78), at(x, 0.69)], fill="#d9a93c")
        oval(x, 0.78, 0.024, 0.03, "#1d4f6e")
    draw.polygon([at(0, 0.6), at(0.07, 0.5), at(0, 0.36), at(-0.07, 0.5)], fill="#a3261c")
    return shade(picture, 12, 0.3, 22)


def drum_shell() -> np.ndarray:
    """Paint lozenges and stripes around a drum."""
    width, height = 1536, 512
    picture = Image.new("RGB", (width, height), "#9c2a22")
    draw = ImageDraw.Draw(picture)
    for k in range(8):
        x0, step = k * width / 8, width / 8
        middle = (x0 + step / 2, height / 2)
        for scale, colour in ((0.46, "#e3c679"), (0.38, "#1f4a5e"), (0.25, "#e3c679"), (0.14, "#9c2a22")):
            dx, dy = step * scale, height * scale * 0.9
            draw.polygon(
                [
                    (middle[0] - dx, middle[1]),
                    (middle[0], middle[1] - dy),
                    (middle[0] + dx, middle[1]),
                    (middle[0], middle[1] + dy),
                ],
                fill=colour,
            )
    return shade(picture, 10, 0.7, 31)


def parquet(seed: int) -> np.ndarray:
    """Paint oak planks of different tones in staggered rows."""
    size, rows = 2048, 26
    rng = np.random.default_rng(seed)
    grain = np.asarray(
        Image.fromarray(noise(size, size // 8, 24, 6, seed)).resize((size, size), Image.BICUBIC)
    )
    floor = np.zeros((size, size, 3), np.float32)
    tones = np.array(
        [[176, 122, 70], [150, 98, 54], [196, 146, 92], [126, 80, 44], [166, 108, 66]], np.float32
    )
    tall = size // rows
    for row in range(rows + 1):
        x = -int(rng.integers(0, 400))
        while x < size:
            long = int(rng.integers(240, 460))
            shift = int(rng.integers(0, size))
            area = np.s_[row * tall : (row + 1) * tall, max(x, 0) : x + long]
            tone = tones[rng.integers(len(tones))] * rng.uniform(0.85, 1.12)
            floor[area] = tone * (0.62 + 0.75 * np.roll(grain, shift, axis=0)[area][..., None])
            floor[row * tall : row * tall + 3, max(x, 0) : x + long] *= 0.4
            floor[row * tall : (row + 1) * tall, max(x, 0) : max(x, 0) + 3] *= 0.4
            x += long
    return np.clip(floor, 0, 255).astype(np.uint8)


def landscape(
    seed: int, sky: Sequence[str], land: Sequence[str], width: int = 1024, height: int = 720
) -> np.ndarray:
    """Paint an oil landscape: clouds, receding ridges, a lake, trees."""
    rng = np.random.default_rng(seed)

    def rgb(colour: str) -> np.ndarray:
        return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], np.float32)

    t = np.linspace(0, 1, height)[:, None, None]
    canvas = np.broadcast_to(rgb(sky[0]) * (1 - t) + rgb(sky[1]) * t, (height, width, 3)).copy()
    clouds = np.clip((noise(height, width, 4, 7, seed) - 0.5) * 3.5, 0, 1)[..., None] * (1 - t)
    canvas = canvas * (1 - clouds) + rgb(sky[2]) * clouds
    rows = np.arange(height)[:, None]
    for layer, colour in enumerate(land):
        ridge = noise(8, width, 3 + 2 * layer, 6, seed + 7 * layer + 1)[4]
        level = height * (0.42 + 0.13 * layer + (0.34 - 0.07 * layer) * (0.5 - ridge))
        texture = noise(height, width, 16, 6, seed + 90 + layer)[..., None]
        canvas = np.where((rows > level)[..., None], rgb(colour) * (0.5 + texture), canvas)
    picture = Image.fromarray(np.clip(canvas, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    for _ in range(26):
        x, y, s = rng.uniform(0, width), rng.uniform(0.68, 0.98) * height, rng.uniform(24, 80)
        draw.line([(x, y), (x + rng.uniform(-6, 6), y - s)], fill="#2c2118", width=max(3, int(s / 9)))
        for _ in range(26):
            dx, dy, r = rng.normal(0, s * 0.33), rng.normal(0, s * 0.28), rng.uniform(0.06, 0.16) * s
            green = tuple(int(c * rng.uniform(0.55, 1.35)) for c in rgb(land[-1]))
            draw.ellipse([x + dx - r, y - s + dy - r, x + dx + r, y - s + dy + r], fill=green)
    return shade(picture, 40, 0.5, seed + 3)


def tapestry(seed: int) -> np.ndarray:
    """Paint a woven hanging: rows of medallions in irregular colours, with a border."""
    width, height = 720, 1024
    rng = np.random.default_rng(seed)
    colours = ("#7a1f22", "#1f3a55", "#c79a45", "#d8c9a3", "#3f5a3a", "#8d4a2a")
    picture = Image.new("RGB", (width, height), "#5c1a1e")
    draw = ImageDraw.Draw(picture)
    draw.rectangle([30, 30, width - 30, height - 30], outline="#d8c9a3", width=14)
    for row in range(7):
        for column in range(4):
            x, y = 60 + (column + 0.5) * (width - 120) / 4, 60 + (row + 0.5) * (height - 120) / 7
            for r in (66, 50, 34, 17):
                sides = int(rng.choice([4, 6, 8, 12]))
                turn = rng.uniform(0, pi)
                corners = [
                    (x + r * cos(turn + 2 * pi * k / sides), y + r * sin(turn + 2 * pi * k / sides))
                    for k in range(sides)
                ]
                draw.polygon(corners, fill=colours[rng.integers(len(colours))])
    weave = 0.85 + 0.3 * np.random.default_rng(seed + 1).random((height, width, 1))
    return np.clip(shade(picture, 12, 0.4, seed) * weave, 0, 255).astype(np.uint8)
