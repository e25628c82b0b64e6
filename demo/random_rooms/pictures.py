# SPDX-License-Identifier: GPL-3.0-or-later
"""Patterns of painted surfaces, as uint8 sRGB arrays of shape (h, w, 3). Each is drawn from colours and a seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, sin

import numpy as np
from PIL import Image, ImageDraw
from studio.textures import noise, shade

Colours = Sequence[str]
Rng = np.random.Generator
Painter = Callable[[ImageDraw.ImageDraw, int, int, Colours, Rng], None]


def paint(pattern: str, colours: Colours, seed: int, size: tuple[int, int]) -> np.ndarray:
    """Return a picture of this size (h, w): a pattern in these colours, of which the first is the ground."""
    height, width = size
    rng = np.random.default_rng(seed)
    picture = Image.new("RGB", (width, height), colours[0])
    PATTERNS[pattern](ImageDraw.Draw(picture), width, height, colours, rng)
    return shade(picture, 10, 0.3, seed)


def bands(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw horizontal bands of ornaments, which repeat around a vessel."""
    y = 0.0
    while y < h:
        tall = h * float(rng.uniform(0.05, 0.22))
        fill = colours[int(rng.integers(1, len(colours)))]
        kind, n = int(rng.integers(6)), int(rng.integers(8, 25))
        step = w / n
        middle = y + tall / 2
        if kind == 0:
            draw.rectangle([0, y, w, y + tall * 0.6], fill=fill)
        for k in range(n):
            x = k * step
            if kind == 1:
                corners = [(x, y + tall * 0.9), (x + step / 2, y + tall * 0.1), (x + step, y + tall * 0.9)]
                draw.line(corners, fill=fill, width=max(3, int(tall / 7)))
            elif kind == 2:
                r = 0.33 * min(step, tall)
                draw.ellipse([x + step / 2 - r, middle - r, x + step / 2 + r, middle + r], fill=fill)
            elif kind == 3:
                draw.polygon(
                    [(x + step / 2, y), (x + step * 0.9, middle), (x + step / 2, y + tall), (x + step * 0.1, middle)],
                    fill=fill,
                )
            elif kind == 4:
                draw.rectangle([x + step * 0.15, y + tall * 0.1, x + step * 0.6, y + tall * 0.9], fill=fill)
            elif kind == 5:
                wave = [(x + step * t, middle + 0.35 * tall * sin(2 * pi * t)) for t in np.linspace(0, 1, 13).tolist()]
                draw.line(wave, fill=fill, width=max(3, int(tall / 6)), joint="curve")
        y += tall
        draw.rectangle([0, y, w, y + h * 0.012], fill=colours[1])
        y += h * 0.03


def floral(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw scattered flowers with leaves."""
    for _ in range(26):
        x, y = float(rng.uniform(0, w)), float(rng.uniform(0, h))
        size = float(rng.uniform(0.035, 0.085)) * min(w, h) * 1.4
        stem = [
            (x, y),
            (x + float(rng.normal(0, size)), y + 2 * size),
            (x + float(rng.normal(0, size)), y + 3.2 * size),
        ]
        draw.line(stem, fill=colours[1], width=max(2, int(size / 6)), joint="curve")
        for side in (-1, 1):
            box = [
                x + side * size * 0.7 - size * 0.5,
                y + 1.6 * size,
                x + side * size * 0.7 + size * 0.5,
                y + 2.1 * size,
            ]
            draw.ellipse(box, fill=colours[1])
        petals, fill = int(rng.integers(5, 9)), colours[int(rng.integers(2, len(colours)))]
        for k in range(petals):
            a = 2 * pi * k / petals
            px, py, r = x + 0.6 * size * cos(a), y + 0.6 * size * sin(a), 0.36 * size
            draw.ellipse([px - r, py - r, px + r, py + r], fill=fill)
        draw.ellipse([x - 0.3 * size, y - 0.3 * size, x + 0.3 * size, y + 0.3 * size], fill=colours[1])


def checks(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw rectangles of changing colours."""
    columns, rows = int(rng.integers(6, 14)), int(rng.integers(4, 10))
    for i in range(columns):
        for j in range(rows):
            if (i + j) % 2 or rng.random() < 0.12:
                at = [i * w / columns, j * h / rows, (i + 1) * w / columns, (j + 1) * h / rows]
                draw.rectangle(at, fill=colours[1 + int(rng.integers(len(colours) - 1)) if rng.random() < 0.3 else 1])


def stripes(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw upright stripes of changing widths."""
    x = 0.0
    while x < w:
        wide = w * float(rng.uniform(0.015, 0.07))
        draw.rectangle([x, 0, x + wide, h], fill=colours[int(rng.integers(1, len(colours)))])
        x += wide + w * float(rng.uniform(0.02, 0.08))


def diamonds(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw a net of diamonds with dots."""
    n = int(rng.integers(5, 11))
    step = w / n
    for j in range(-1, int(h / step) * 2 + 2):
        for i in range(-1, n + 1):
            x, y = (i + 0.5 * (j % 2)) * step, j * step / 2
            fill = colours[1 + (i * 3 + j * 5) % (len(colours) - 1)]
            draw.polygon(
                [(x, y - step * 0.42), (x + step * 0.42, y), (x, y + step * 0.42), (x - step * 0.42, y)],
                outline=fill,
                width=6,
            )
            draw.ellipse([x - step * 0.12, y - step * 0.12, x + step * 0.12, y + step * 0.12], fill=fill)


def blobs(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw irregular patches with outlines: a map, camouflage or marbled paper."""
    for _ in range(11):
        x, y = float(rng.uniform(0, w)), float(rng.uniform(0.12 * h, 0.88 * h))
        turns = np.linspace(0, 2 * pi, 40, endpoint=False)
        reach = np.ones(40)
        for k in range(2, 8):
            reach += float(rng.normal(0, 0.55)) / k * np.cos(k * turns + float(rng.uniform(0, 6)))
        size = float(rng.uniform(0.08, 0.22)) * h
        fill = colours[int(rng.integers(2, len(colours)))]
        for shift in (-w, 0, w):
            points = [
                (x + shift + 1.3 * size * r * cos(a), y + size * r * sin(a))
                for r, a in zip(reach.tolist(), turns.tolist(), strict=True)
            ]
            draw.polygon(points, fill=fill, outline=colours[1], width=4)


def globe(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw a map of invented continents with meridians and parallels."""
    blobs(draw, w, h, colours, rng)
    for k in range(12):
        draw.line([(k * w / 12, 0), (k * w / 12, h)], fill=colours[1], width=2)
    for k in range(1, 6):
        draw.line([(0, k * h / 6), (w, k * h / 6)], fill=colours[1], width=2)


def landscape(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Paint hills, trees and a sun under a sky."""
    sun, r = (float(rng.uniform(0.15, 0.85)) * w, float(rng.uniform(0.12, 0.3)) * h), 0.06 * h
    draw.ellipse([sun[0] - r, sun[1] - r, sun[0] + r, sun[1] + r], fill=colours[-1])
    x = np.linspace(0, w, 80)
    for layer in range(4):
        y = h * (0.4 + 0.13 * layer)
        ridge = y + sum(h * 0.05 / k * np.sin(2 * pi * k * x / w + float(rng.uniform(0, 6))) for k in (1, 2, 4, 7))
        fill = colours[1 + layer % (len(colours) - 1)]
        draw.polygon([*zip(x.tolist(), ridge.tolist(), strict=True), (w, h), (0, h)], fill=fill)
        for _ in range(int(rng.integers(3, 8))):
            k = int(rng.integers(80))
            size = h * 0.03 * (1 + layer) * float(rng.uniform(0.6, 1.2))
            foot = (float(x[k]), float(ridge[k]))
            draw.line([foot, (foot[0], foot[1] - size)], fill=colours[1], width=max(2, int(size / 7)))
            box = [foot[0] - 0.6 * size, foot[1] - 2.2 * size, foot[0] + 0.6 * size, foot[1] - 0.8 * size]
            draw.ellipse(box, fill=colours[1 + (layer + 2) % (len(colours) - 1)])


def portrait(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Paint the head and shoulders of a sitter before a dark ground."""
    skin = ("#d9a67f", "#b87d56", "#7c5136", "#e6bf9c")[int(rng.integers(4))]
    cx, cy, r = w * float(rng.uniform(0.44, 0.56)), h * 0.38, min(w, h) * 0.17
    draw.polygon(
        [(cx - 3 * r, h), (cx - 1.7 * r, cy + 1.9 * r), (cx + 1.7 * r, cy + 1.9 * r), (cx + 3 * r, h)], fill=colours[2]
    )
    draw.rectangle([cx - 0.4 * r, cy, cx + 0.4 * r, cy + 2 * r], fill=skin)
    draw.ellipse([cx - 1.15 * r, cy - 1.65 * r, cx + 1.15 * r, cy + 0.7 * r], fill=colours[1])
    draw.ellipse([cx - 0.85 * r, cy - 1.1 * r, cx + 0.85 * r, cy + 1.25 * r], fill=skin)
    for side in (-1, 1):
        x = cx + side * 0.36 * r
        draw.ellipse([x - 0.16 * r, cy - 0.15 * r, x + 0.16 * r, cy + 0.05 * r], fill="#f4efe6")
        draw.ellipse([x - 0.08 * r, cy - 0.13 * r, x + 0.08 * r, cy + 0.03 * r], fill="#2a1e16")
        draw.line(
            [(x - 0.22 * r, cy - 0.3 * r), (x + 0.22 * r, cy - 0.34 * r)], fill="#3a2618", width=max(2, int(0.08 * r))
        )
    draw.line([(cx, cy - 0.1 * r), (cx + 0.12 * r, cy + 0.4 * r), (cx, cy + 0.44 * r)], fill="#7a4a30", width=3)
    draw.arc(
        [cx - 0.35 * r, cy + 0.45 * r, cx + 0.35 * r, cy + 0.85 * r],
        20,
        160,
        fill="#8a2f2a",
        width=max(3, int(0.1 * r)),
    )
    draw.polygon([(cx - 0.9 * r, cy + 1.9 * r), (cx + 0.9 * r, cy + 1.9 * r), (cx, cy + 3.1 * r)], fill=colours[3])


def abstract(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Paint overlapping discs, beams and squares."""
    for k in range(22):
        fill = colours[int(rng.integers(1, len(colours)))]
        x, y, r = float(rng.uniform(0, w)), float(rng.uniform(0, h)), float(rng.uniform(0.04, 0.2)) * h
        if k % 3 == 0:
            draw.ellipse([x - r, y - r, x + r, y + r], fill=fill, outline=colours[0], width=4)
        elif k % 3 == 1:
            a = float(rng.uniform(0, pi))
            draw.line(
                [(x - 3 * r * cos(a), y - 3 * r * sin(a)), (x + 3 * r * cos(a), y + 3 * r * sin(a))],
                fill=fill,
                width=int(r / 2) + 2,
            )
        else:
            draw.rectangle([x - r, y - r * 0.7, x + r, y + r * 0.7], fill=fill)


def sunburst(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw rings and rays around the middle, for shields and plates."""
    cx, cy, half = w / 2, h / 2, min(w, h) / 2
    rays, fills = int(rng.integers(7, 17)), [colours[int(rng.integers(1, len(colours)))] for _ in range(4)]
    draw.ellipse([cx - half, cy - half, cx + half, cy + half], fill=fills[0])
    draw.ellipse([cx - 0.82 * half, cy - 0.82 * half, cx + 0.82 * half, cy + 0.82 * half], fill=colours[0])
    for k in range(rays):
        a, b = 2 * pi * k / rays, pi / rays * float(rng.uniform(0.4, 0.6))
        tip = (cx + 0.8 * half * cos(a), cy + 0.8 * half * sin(a))
        feet = [(cx + 0.3 * half * cos(a + s * 2 * b), cy + 0.3 * half * sin(a + s * 2 * b)) for s in (-1, 1)]
        draw.polygon([tip, *feet], fill=fills[1 + k % 2])
        r = 0.045 * half
        x, y = cx + 0.91 * half * cos(a + 0.2), cy + 0.91 * half * sin(a + 0.2)
        draw.ellipse([x - r, y - r, x + r, y + r], fill=colours[0])
    draw.ellipse(
        [cx - 0.3 * half, cy - 0.3 * half, cx + 0.3 * half, cy + 0.3 * half], fill=fills[3], outline=colours[1], width=5
    )


def dial(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw a clock face with ticks and two hands."""
    cx, cy, half = w / 2, h / 2, min(w, h) / 2
    for k in range(60):
        a, long = 2 * pi * k / 60, 0.16 if k % 5 == 0 else 0.06
        ends = [(cx + r * half * sin(a), cy - r * half * cos(a)) for r in (0.9, 0.9 - long)]
        draw.line(ends, fill=colours[1], width=9 if k % 5 == 0 else 3)
    hour, minute = float(rng.uniform(0, 2 * pi)), float(rng.uniform(0, 2 * pi))
    for angle, long, wide in ((hour, 0.5, 16), (minute, 0.76, 10)):
        draw.line(
            [(cx, cy), (cx + long * half * sin(angle), cy - long * half * cos(angle))], fill=colours[1], width=wide
        )
    draw.ellipse([cx - 0.06 * half, cy - 0.06 * half, cx + 0.06 * half, cy + 0.06 * half], fill=colours[2])


def pages(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw lines of writing with an initial and a small picture."""
    y = h * 0.08
    while y < h * 0.92:
        x = w * (0.3 if y < h * 0.26 else 0.1)
        while x < w * 0.88:
            long = w * float(rng.uniform(0.03, 0.12))
            draw.rectangle([x, y, min(x + long, w * 0.9), y + h * 0.018], fill=colours[1])
            x += long + w * 0.025
        y += h * 0.045
    draw.rectangle([w * 0.1, h * 0.07, w * 0.26, h * 0.25], fill=colours[2])
    draw.ellipse([w * 0.55, h * 0.6, w * 0.85, h * 0.85], fill=colours[3])


def cover(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw a book cover: frames, a title and an emblem."""
    for k, inset in enumerate((0.05, 0.09, 0.2)):
        draw.rectangle([w * inset, h * inset, w * (1 - inset), h * (1 - inset)], outline=colours[1 + k % 3], width=7)
    for k in range(3):
        half = w * float(rng.uniform(0.1, 0.25))
        y = h * (0.28 + 0.07 * k)
        draw.rectangle([w / 2 - half, y, w / 2 + half, y + h * 0.035], fill=colours[1])
    r = 0.13 * min(w, h)
    points = int(rng.integers(4, 9))
    star = [
        (
            w / 2 + r * (1 if k % 2 else 0.45) * sin(pi * k / points),
            h * 0.66 - r * (1 if k % 2 else 0.45) * cos(pi * k / points),
        )
        for k in range(2 * points)
    ]
    draw.polygon(star, fill=colours[2])


def carpet(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw a symmetric carpet or tapestry: borders, a field of motifs and a medallion."""
    for k, inset in enumerate((0.0, 0.05, 0.07, 0.15)):
        draw.rectangle([w * inset, h * inset, w * (1 - inset), h * (1 - inset)], fill=colours[(1, 2, 3, 0)[k]])
    n = int(rng.integers(5, 9))
    motif = int(rng.integers(3))
    for i in range(n):
        for j in range(n):
            x, y, r = w * (0.2 + 0.6 * (i + 0.5) / n), h * (0.2 + 0.6 * (j + 0.5) / n), 0.25 * min(w, h) / n
            fill = colours[1 + (i * j + i + j) % 3]
            if motif == 0:
                draw.polygon([(x, y - r), (x + r, y), (x, y + r), (x - r, y)], fill=fill)
            elif motif == 1:
                draw.ellipse([x - r, y - r, x + r, y + r], outline=fill, width=5)
            else:
                draw.line([(x - r, y), (x + r, y)], fill=fill, width=6)
                draw.line([(x, y - r), (x, y + r)], fill=fill, width=6)
    for k, size in enumerate((0.2, 0.14, 0.07)):
        draw.ellipse([w * (0.5 - size), h * (0.5 - size), w * (0.5 + size), h * (0.5 + size)], fill=colours[1 + k])
    for k in range(20):
        for at in (0.1, 0.9):
            x, y, r = w * (k + 0.5) / 20, h * at, 0.012 * w
            draw.ellipse([x - r, y - r, x + r, y + r], fill=colours[2])


def poster(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw an information panel: a heading, columns of text, a picture and a plan."""
    draw.rectangle([w * 0.06, h * 0.05, w * float(rng.uniform(0.5, 0.9)), h * 0.11], fill=colours[1])
    split = float(rng.uniform(0.3, 0.5))
    draw.rectangle([w * 0.06, h * 0.16, w * 0.94, h * split], fill=colours[2])
    for _ in range(8):
        x, y, r = (
            float(rng.uniform(0.1, 0.9)) * w,
            float(rng.uniform(0.2, split - 0.05)) * h,
            float(rng.uniform(0.01, 0.05)) * w,
        )
        draw.ellipse([x - r, y - r, x + r, y + r], fill=colours[int(rng.integers(4))])
    for left in (0.06, 0.54):
        y = h * (split + 0.05)
        while y < h * 0.94:
            draw.rectangle([w * left, y, w * (left + float(rng.uniform(0.2, 0.4))), y + h * 0.012], fill=colours[1])
            y += h * 0.03


def planks(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw floor boards of different tones with knots."""
    rows = 12
    for row in range(rows):
        x = -w * float(rng.uniform(0, 0.4))
        while x < w:
            long = w * float(rng.uniform(0.25, 0.55))
            base = np.array(Image.new("RGB", (1, 1), colours[int(rng.integers(len(colours)))]))[0, 0]
            fill = tuple(int(c) for c in np.clip(base * rng.uniform(0.8, 1.2), 0, 255))
            draw.rectangle([x, row * h / rows, x + long, (row + 1) * h / rows], fill=fill, outline="#2a2018", width=3)
            for _ in range(3):
                kx, ky, r = x + long * float(rng.random()), (row + float(rng.uniform(0.25, 0.75))) * h / rows, h * 0.008
                draw.ellipse([kx - 2 * r, ky - r, kx + 2 * r, ky + r], fill=tuple(int(0.6 * c) for c in fill))
            x += long


def tiles(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw floor tiles of changing colours, some with ornaments."""
    n = 8
    step = w / n
    for i in range(n):
        for j in range(n):
            x, y = i * step, j * h / n
            fill = colours[(i + j) % 2 if rng.random() < 0.85 else int(rng.integers(len(colours)))]
            draw.rectangle([x, y, x + step, y + h / n], fill=fill, outline="#4a443c", width=3)
            if rng.random() < 0.5:
                r = step * float(rng.uniform(0.12, 0.3))
                cx, cy = x + step / 2, y + h / n / 2
                accent = colours[2 + int(rng.integers(2))]
                draw.polygon([(cx, cy - r), (cx + r, cy), (cx, cy + r), (cx - r, cy)], fill=accent)


def bricks(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw bricks or blocks with joints in the ground colour; the pattern tiles in x."""
    rows, across = int(rng.integers(8, 16)), int(rng.integers(4, 7))
    tall, wide = h / rows, w / across
    for row in range(rows):
        for k in range(across):
            base = np.array(Image.new("RGB", (1, 1), colours[int(rng.integers(1, len(colours)))]))[0, 0]
            fill = tuple(int(c) for c in np.clip(base * rng.uniform(0.8, 1.15), 0, 255))
            x = (k + 0.5 * (row % 2)) * wide
            for left in (x, x - w):
                draw.rounded_rectangle([left + 3, row * tall + 3, left + wide - 3, (row + 1) * tall - 3], 5, fill=fill)


def wallpaper(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw a wallpaper: columns of leaves and stripes that tile in both directions."""
    columns = int(rng.integers(3, 6))
    step = w / columns
    for k in range(columns):
        x = (k + 0.5) * step
        draw.rectangle([x - step * 0.5, 0, x - step * 0.44, h], fill=colours[2])
        for j in range(6):
            y = (j + 0.5 * (k % 2)) * h / 6
            for side in (-1, 1):
                leaf = [x + side * step * 0.16 - step * 0.13, y, x + side * step * 0.16 + step * 0.13, y + h * 0.06]
                draw.ellipse(leaf, fill=colours[1])
            draw.ellipse([x - step * 0.08, y - h * 0.03, x + step * 0.08, y + h * 0.01], fill=colours[3])


def streaks(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw marks and stains on a bare floor or wall."""
    for _ in range(60):
        x, y, r = float(rng.uniform(0, w)), float(rng.uniform(0, h)), float(rng.uniform(0.004, 0.03)) * w
        fill = colours[int(rng.integers(1, len(colours)))]
        draw.ellipse([x - r, y - r * float(rng.uniform(0.3, 1)), x + r, y + r], fill=fill)
    for _ in range(20):
        crack = np.cumsum(rng.normal(0, 0.012 * w, (12, 2)), axis=0) + rng.uniform(0, w, 2)
        draw.line([tuple(p) for p in crack.tolist()], fill=colours[1], width=3)


def clouded(draw: ImageDraw.ImageDraw, w: int, h: int, colours: Colours, rng: Rng) -> None:
    """Draw soft clouds of the colours, for plaster and glazes."""
    field = noise(h, w, 4, 5, int(rng.integers(2**31)), tile=True)
    for level, fill in zip((0.45, 0.52, 0.6), colours[1:], strict=True):
        draw.bitmap((0, 0), Image.fromarray(((field > level) * 90).astype(np.uint8)), fill=fill)


PATTERNS: dict[str, Painter] = {
    "bands": bands,
    "floral": floral,
    "checks": checks,
    "stripes": stripes,
    "diamonds": diamonds,
    "blobs": blobs,
    "globe": globe,
    "landscape": landscape,
    "portrait": portrait,
    "abstract": abstract,
    "sunburst": sunburst,
    "dial": dial,
    "pages": pages,
    "cover": cover,
    "carpet": carpet,
    "poster": poster,
    "planks": planks,
    "tiles": tiles,
    "bricks": bricks,
    "wallpaper": wallpaper,
    "streaks": streaks,
    "clouded": clouded,
}
