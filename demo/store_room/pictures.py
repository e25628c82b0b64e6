# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural textures of the store room, as uint8 sRGB arrays of shape (h, w, 3)."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from studio.textures import noise, shade

INK = "#2a1c12"


def bricks(seed: int) -> np.ndarray:
    """Paint bricks of different tones with pale joints."""
    size, rows, across = 1536, 24, 9
    rng = np.random.default_rng(seed)
    picture = Image.new("RGB", (size, size), "#a39a8c")
    draw = ImageDraw.Draw(picture)
    tall, wide = size / rows, size / across
    tones = np.array([[146, 74, 54], [166, 92, 68], [128, 62, 48], [176, 112, 84], [112, 62, 54], [156, 126, 104]])
    for row in range(rows):
        for k in range(-1, across + 1):
            x = (k + 0.5 * (row % 2)) * wide
            # The same brick on both sides of the seam, so that the texture tiles seamlessly.
            tone = tones[(row * 7 + (k % across) * 5 + (row * k % across) ** 2) % len(tones)]
            fill = tuple(int(c) for c in np.clip(tone * (0.82 + 0.05 * ((row * 3 + k % across * 11) % 8)), 0, 255))
            x0, y0 = x + 5 + rng.uniform(-2, 2), row * tall + 5 + rng.uniform(-2, 2)
            draw.rounded_rectangle([x0, y0, x + wide - 5, (row + 1) * tall - 5], 6, fill=fill)
    return shade(picture, 14, 0.75, seed)


def concrete(seed: int) -> np.ndarray:
    """Paint a floor of stained concrete slabs with painted marks."""
    size = 2048
    rng = np.random.default_rng(seed)
    grey = 92 + 95 * noise(size, size, 6, 9, seed)[..., None] + np.zeros(3) + np.array([6, 2, -6])
    picture = Image.fromarray(np.clip(grey, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(picture, "RGBA")
    for _ in range(70):
        x, y, r = rng.uniform(0, size, 2).tolist() + [float(rng.uniform(8, 60))]
        tone = (40, 34, 28, int(rng.integers(14, 60))) if rng.random() < 0.6 else (220, 214, 200, 40)
        draw.ellipse([x - r, y - r * rng.uniform(0.4, 1), x + r, y + r], fill=tone)
    for k in range(5):
        at = k * size / 4
        draw.line([(at, 0), (at, size)], fill=(30, 28, 26, 230), width=9)
        draw.line([(0, at), (size, at)], fill=(30, 28, 26, 230), width=9)
    for _ in range(26):
        crack = np.cumsum(rng.normal(0, 26, (14, 2)), axis=0) + rng.uniform(0, size, 2)
        draw.line([tuple(p) for p in crack.tolist()], fill=(38, 34, 30, 190), width=4)
    draw.line([(0, size * 0.62), (size, size * 0.55)], fill=(206, 168, 40, 150), width=46)
    return np.asarray(picture)


def majolica() -> np.ndarray:
    """Paint a pitcher: green and yellow leaves and fruit on cream, with bands, from foot (bottom) to lip."""
    width, height = 1600, 1000
    rng = np.random.default_rng(8)
    picture = Image.new("RGB", (width, height), "#efe3c0")
    draw = ImageDraw.Draw(picture)
    for top, tall, colour in ((0.0, 0.06, "#2f6a4c"), (0.08, 0.02, "#c98a1e"), (0.9, 0.1, "#2f6a4c")):
        draw.rectangle([0, top * height, width, (top + tall) * height], fill=colour)
    for k in range(32):
        x = k * width / 32
        draw.polygon([(x, 880), (x + 25, 800), (x + 50, 880)], fill="#c98a1e" if k % 2 else "#2b4f7c")
    for k in range(8):
        x, y = (k + 0.5) * width / 8, 420 + 60 * (-1) ** k
        vine = [(x + 70 * sin(t * 5), y - 250 + 500 * t) for t in np.linspace(0, 1, 30)]
        draw.line(vine, fill="#2f6a4c", width=11)
        for px, py in vine[2::4]:
            turn, reach = rng.uniform(0, 2 * pi), rng.uniform(36, 62)
            tip = (px + reach * cos(turn), py + reach * sin(turn))
            aside = (0.35 * reach * sin(turn), -0.35 * reach * cos(turn))
            middle = ((px + tip[0]) / 2, (py + tip[1]) / 2)
            corners = [(px, py), (middle[0] + aside[0], middle[1] + aside[1]), tip]
            corners.append((middle[0] - aside[0], middle[1] - aside[1]))
            draw.polygon(corners, fill=("#2f6a4c", "#4f8a4a", "#87a03c")[int(rng.integers(3))])
        for dx, dy in ((0, 0), (-44, 50), (40, 56), (-4, 98)):
            box = [x + dx - 32, y + dy - 32, x + dx + 32, y + dy + 32]
            draw.ellipse(box, fill=("#c8501e", "#d9982a")[k % 2], outline="#7a3416", width=5)
    return shade(picture, 8, 0.3, 9)


def nautilus() -> np.ndarray:
    """Paint a shell's flames: u runs around the tube, v from the middle of the spiral to its mouth."""
    width, height = 512, 2048
    u, v = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    wobble = noise(height, width, 4, 5, 3) - 0.5
    # Dark stripes that become narrower from the outer side (u = 0 and 1) to the sides.
    outer = np.abs(u - 0.5) * 2
    flame = np.sin(2 * pi * (v * 26 + 1.6 * wobble + 0.9 * outer)) - 1.25 + 1.75 * outer
    flame -= 3.0 * np.clip(v - 0.8, 0, 1) * 3
    amount = np.clip(flame * 2.5, 0, 1)[..., None]
    pale, rust = np.array([240, 228, 206]), np.array([150, 66, 26])
    grown = 1 - 0.12 * (np.sin(2 * pi * v * 160) > 0.7)[..., None]
    return np.clip((pale * (1 - amount) + rust * amount) * grown * (0.9 + 0.2 * wobble[..., None]), 0, 255).astype(
        np.uint8
    )


def leather_ball() -> np.ndarray:
    """Paint a football around a sphere: black pentagons, white hexagons and the seams between them."""
    height, width = 700, 1400
    golden = (1 + 5**0.5) / 2
    twelve = np.array([p for a in (-1, 1) for b in (-golden, golden) for p in ((0, a, b), (a, b, 0), (b, 0, a))], float)
    twelve /= np.linalg.norm(twelve, axis=1, keepdims=True)
    distances = np.linalg.norm(twelve[:, None] - twelve[None], axis=-1)
    near = distances < 1.2
    twenty = np.array(
        [twelve[[a, b, c]].sum(0) for a in range(12) for b in range(a) for c in range(b)
         if near[a, b] and near[b, c] and near[a, c]]
    )  # fmt: skip
    twenty /= np.linalg.norm(twenty, axis=1, keepdims=True)
    # Distances of the polyhedron's faces; the nearest face determines the patch.
    reach_5, reach_6 = 0.9393, 0.9149
    around, up = np.meshgrid(np.linspace(0, 2 * pi, width), np.linspace(pi / 2, -pi / 2, height))
    points = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1)
    depth = np.concatenate([points @ twelve.T / reach_5, points @ twenty.T / reach_6], axis=-1)
    ranked = np.sort(depth, axis=-1)
    patch = depth.argmax(axis=-1)
    colour = np.where((patch < 12)[..., None], np.array([34, 31, 30]), np.array([226, 217, 196]))
    seam = (ranked[..., -1] - ranked[..., -2] < 0.012)[..., None]
    return shade(Image.fromarray(np.where(seam, np.array([70, 60, 50]), colour).astype(np.uint8)), 10, 0.5, 4)


def wine_label() -> np.ndarray:
    """Paint the side of a bottle: dark glass with a paper label around the lower half."""
    width, height = 1024, 1024
    picture = Image.new("RGB", (width, height), "#16301c")
    draw = ImageDraw.Draw(picture)
    for x in (40, 552):
        draw.rectangle([x, 560, x + 430, 900], fill="#ead9ac", outline="#8d6a24", width=12)
        draw.ellipse([x + 150, 585, x + 280, 700], fill="#7a1f22", outline="#c79a3a", width=8)
        draw.text((x + 215, 745), "CHATEAU", font=ImageFont.load_default(size=66), fill=INK, anchor="mm")
        draw.text((x + 215, 820), "1887", font=ImageFont.load_default(size=74), fill="#7a1f22", anchor="mm")
    return shade(picture, 9, 0.35, 6)


def dial() -> np.ndarray:
    """Paint a clock's face with Roman hours and the hands at ten past ten."""
    size = 1024
    c = size / 2
    picture = Image.new("RGB", (size, size), "#f0e8d2")
    draw = ImageDraw.Draw(picture)

    def at(r: float, turn: float) -> tuple[float, float]:
        return c + r * c * sin(turn), c - r * c * cos(turn)

    for r, width in ((0.93, 7), (0.86, 5)):
        draw.ellipse([c - r * c, c - r * c, c + r * c, c + r * c], outline=INK, width=width)
    for k in range(60):
        draw.line([at(0.86, 2 * pi * k / 60), at(0.93, 2 * pi * k / 60)], fill=INK, width=12 if k % 5 == 0 else 5)
    for k, hour in enumerate(("XII", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI")):
        draw.text(at(0.68, 2 * pi * k / 12), hour, font=ImageFont.load_default(size=112), fill=INK, anchor="mm")
    for turn, reach, width in ((2 * pi * 10.17 / 12, 0.42, 34), (2 * pi * 10 / 60, 0.66, 22)):
        draw.line([at(-0.1, turn), at(reach, turn)], fill="#101418", width=width)
    draw.ellipse([c - 34, c - 34, c + 34, c + 34], fill="#8a6420")
    return shade(picture, 7, 0.22, 5)


def carton(seed: int) -> np.ndarray:
    """Paint one side of a cardboard box with tape, words and a number that depend on `seed`."""
    width, height = 640, 480
    rng = np.random.default_rng(seed)
    tone = np.array([178, 136, 88]) * rng.uniform(0.78, 1.1) + rng.normal(0, 6, 3)
    picture = Image.new("RGB", (width, height), tuple(int(c) for c in np.clip(tone, 0, 255)))
    draw = ImageDraw.Draw(picture)
    for y in range(0, height, 9):
        draw.line([(0, y), (width, y)], fill=tuple(int(c) for c in np.clip(tone * 0.93, 0, 255)), width=2)
    tape = float(rng.uniform(0.35, 0.65)) * width
    draw.rectangle([tape - 34, 0, tape + 34, height * 0.4], fill="#c9ad74")
    words = ("FRAGILE", "ARCHIVE", "STORE", "GLASS", "THIS SIDE UP", "LOT", "HALL", "WEST WING")
    inks = ("#7c1f1c", "#1f2f5c", "#2a2420", "#24502c")
    for k in range(2):
        where = (float(rng.uniform(0.3, 0.7)) * width, (0.52 + 0.3 * k) * height)
        text = f"{words[int(rng.integers(len(words)))]} {int(rng.integers(10, 999))}"
        font = ImageFont.load_default(size=int(rng.integers(56, 92)))
        draw.text(where, text, font=font, fill=inks[int(rng.integers(4))], anchor="mm")
    x, y = float(rng.uniform(0.04, 0.7)) * width, float(rng.uniform(0.05, 0.25)) * height
    draw.rectangle([x, y, x + 150, y + 90], fill="#efe8d8", outline=INK, width=4)
    for k in range(22):
        draw.line([(x + 10 + 6 * k, y + 12), (x + 10 + 6 * k, y + 76)], fill=INK, width=int(rng.integers(1, 5)))
    return shade(picture, 8, 0.5, seed)


def poster(seed: int) -> np.ndarray:
    """Paint an old exhibition poster: a large word, a sign and lines of text."""
    width, height = 700, 1000
    rng = np.random.default_rng(seed)
    grounds = ("#2a4a66", "#b8452c", "#d9b45a", "#3c5a3a", "#5a3a5c")
    ground = grounds[seed % len(grounds)]
    picture = Image.new("RGB", (width, height), ground)
    draw = ImageDraw.Draw(picture)
    draw.rectangle([24, 24, width - 24, height - 24], outline="#efe6cf", width=8)
    word = ("AEGYPTUS", "OCEANS", "TIME", "MINERALS", "SONG")[seed % 5]
    draw.text((width / 2, 130), word, font=ImageFont.load_default(size=104), fill="#efe6cf", anchor="mm")
    for k in range(9):
        a, r = rng.uniform(0, 2 * pi), rng.uniform(60, 190)
        x, y = width / 2 + r * cos(a), 480 + r * sin(a)
        s = rng.uniform(40, 110)
        shape = draw.ellipse if k % 2 else draw.rectangle
        shape([x - s, y - s, x + s, y + s], fill=grounds[int(rng.integers(5))], outline="#efe6cf", width=5)
    for row in range(6):
        y = 770 + row * 34
        draw.line([(90, y), (90 + rng.uniform(0.4, 1) * (width - 180), y)], fill="#efe6cf", width=12)
    return shade(picture, 9, 0.5, seed)
