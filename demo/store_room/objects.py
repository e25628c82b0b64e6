# SPDX-License-Identifier: GPL-3.0-or-later
"""Builders of the exhibits, in metres. Each has its own origin and stands on z = 0, or hangs on a wall behind y = 0."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, pi, radians, sin

import bpy
import numpy as np
import pictures
from mathutils import Matrix
from studio.materials import bronze, mirror, mottled, painted, plain, thin_glass, wood
from studio.meshes import box, from_arrays, lathe, link, smooth, tube
from studio.stage import SEEN_THROUGH, Parts, frame, upright


def pitcher() -> Parts:
    """Build a majolica pitcher with a lip and one handle."""
    glaze = painted("Majolica", pictures.majolica(), 0.3, wear=0.05)
    green = plain("Majolica green", "#2f6a4c", 0.3)
    profile = smooth(
        [(0.0005, 0.0), (0.085, 0.0), (0.088, 0.015), (0.07, 0.04), (0.105, 0.1), (0.128, 0.17), (0.112, 0.25),
         (0.07, 0.32), (0.06, 0.36), (0.08, 0.42), (0.084, 0.425), (0.074, 0.42), (0.054, 0.36), (0.04, 0.3)], 7,
    )  # fmt: skip
    body = lathe("Pitcher", profile, glaze, 96)
    # Extend the rim to one side to form the lip.
    for vertex in body.data.vertices:
        x, y, z = vertex.co
        rise, ahead = max(0.0, (z - 0.35) / 0.075), max(0.0, x) / 0.08
        vertex.co = (x + 0.05 * rise * ahead**3, y * (1 - 0.25 * rise * ahead), z + 0.03 * rise * ahead**2)
    path = [(-0.068, 0, 0.4), (-0.13, 0, 0.43), (-0.18, 0, 0.37), (-0.172, 0, 0.27), (-0.108, 0, 0.19)]
    return [body, tube("Pitcher handle", smooth(path, 8), 0.014, green, 14, 1.4)]


def crate() -> Parts:
    """Build an open crate of slats, full of straw."""
    timber = wood("Crate wood", "#8a6a40", "#c9a56c")
    straw = mottled("Straw", [(0.3, "#a8853c"), (0.7, "#ead08a")], 60, 0.9, speckle=0.6)
    x, y, tall, thick = 0.3, 0.22, 0.32, 0.018
    parts = [box("Crate floor", (2 * x, 2 * y, 0.02), (0, 0, 0.01), timber, 0.003)]
    for k in range(3):
        z = 0.055 + k * 0.105
        for side in (-1, 1):
            parts.append(box("Crate slat", (2 * x, thick, 0.085), (0, side * y, z), timber, 0.004))
            parts.append(box("Crate slat", (thick, 2 * y, 0.085), (side * x, 0, z), timber, 0.004))
    for sx in (-1, 1):
        for sy in (-1, 1):
            post = (sx * (x - 0.025), sy * (y - 0.025), tall / 2)
            parts.append(box("Crate post", (0.035, 0.035, tall), post, timber, 0.004))
    rng = np.random.default_rng(4)
    parts.append(box("Straw bed", (2 * x - 0.03, 2 * y - 0.03, 0.13), (0, 0, 0.085), straw, 0.02))
    for _ in range(110):
        middle = np.array([rng.uniform(-0.24, 0.24), rng.uniform(-0.16, 0.16), rng.uniform(0.15, 0.185)])
        turn, half = rng.uniform(0, pi), rng.uniform(0.03, 0.07)
        offset = np.array([cos(turn), sin(turn), rng.normal(0, 0.25)]) * half
        bend = np.array([0, 0, rng.uniform(-0.01, 0.02)])
        parts.append(tube("Straw", [middle - offset, middle + bend, middle + offset], 0.0035, straw, 5))
    return parts


def bottle() -> Parts:
    """Build a wine bottle with a label, a capsule and shoulders."""
    glass = painted("Bottle", pictures.wine_label(), 0.25, wear=0.1)
    foil = mottled("Capsule", [(0.3, "#5c1418"), (0.7, "#8f2a2e")], 40, 0.4, 0.3)
    profile = smooth(
        [(0.0005, 0.0), (0.046, 0.0), (0.05, 0.008), (0.05, 0.1), (0.05, 0.24), (0.046, 0.27), (0.024, 0.31),
         (0.018, 0.335)], 6,
    )  # fmt: skip
    neck = smooth([(0.0185, 0.33), (0.019, 0.38), (0.018, 0.405), (0.021, 0.408), (0.021, 0.425), (0.0005, 0.427)], 5)
    return [lathe("Bottle", profile, glass, 56), lathe("Bottle capsule", neck, foil, 40)]


def ball() -> Parts:
    """Build a leather football."""
    leather = painted("Football", pictures.leather_ball(), 0.5, wear=0.15)
    turns = np.linspace(-pi / 2, pi / 2, 49)
    profile = np.stack([0.11 * np.cos(turns) + 1e-5, 0.11 + 0.11 * np.sin(turns)], axis=1)
    made = lathe("Football", profile, leather, 80)
    # Convert v from the height to the latitude that the picture uses.
    flat = made.data.uv_layers[0].data
    uvs = np.empty(2 * len(flat), np.float32)
    flat.foreach_get("uv", uvs)
    uvs[1::2] = np.arcsin(np.clip(2 * uvs[1::2] - 1, -1, 1)) / pi + 0.5
    flat.foreach_set("uv", uvs)
    made.rotation_euler = (0.5, 0.3, 0.2)
    made.location = (0, -0.04, 0.01)
    return [made]


def candelabrum() -> Parts:
    """Build a brass candelabrum for five candles: thin curved arms."""
    brass = mottled("Brass", [(0.3, "#7d5c1e"), (0.5, "#c09338"), (0.7, "#dcb860")], 24, 0.38, 0.6, speckle=0.4)
    wax = mottled("Wax", [(0.3, "#e0d4b8"), (0.7, "#f6efdd")], 30, 0.5, speckle=0.15)
    wick = plain("Wick", "#1c1814", 0.9)
    stem = smooth(
        [(0.0005, 0.0), (0.105, 0.0), (0.11, 0.012), (0.08, 0.03), (0.03, 0.05), (0.014, 0.09), (0.012, 0.18),
         (0.024, 0.2), (0.012, 0.22), (0.01, 0.36), (0.018, 0.38), (0.008, 0.4), (0.008, 0.5)], 6,
    )  # fmt: skip
    cup = smooth([(0.005, 0.0), (0.02, 0.008), (0.032, 0.012), (0.03, 0.016), (0.016, 0.018), (0.018, 0.045)], 4)
    candle = [(0.0005, 0.0), (0.0135, 0.0), (0.013, 0.15), (0.011, 0.158), (0.0005, 0.155)]
    parts = [lathe("Candelabrum", stem, brass, 48)]
    tops = [(0.0, 0.5)]
    for side in (-1, 1):
        for reach, low, high in ((0.11, 0.32, 0.45), (0.21, 0.26, 0.4)):
            points = [(0, 0, low + 0.02), (side * reach * 0.45, 0, low - 0.03), (side * reach * 0.95, 0, low + 0.02)]
            parts.append(tube("Arm", smooth([*points, (side * reach, 0, high)], 9), 0.007, brass, 10))
            tops.append((side * reach, high))
    for x, z in tops:
        for name, profile, stuff, lift in (("Cup", cup, brass, 0.0), ("Candle", candle, wax, 0.025)):
            made = lathe(name, profile, stuff, 28)
            made.location = (x, 0, z + lift)
            parts.append(made)
        parts.append(tube("Wick", [(x, 0, z + 0.175), (x + 0.001, 0, z + 0.185), (x, 0, z + 0.198)], 0.0022, wick, 6))
    return parts


def nautilus() -> Parts:
    """Build a nautilus shell standing on a little rest: a tube along a logarithmic spiral."""
    shell = painted("Nautilus", pictures.nautilus(), 0.3, wear=0.06)
    pearl = mottled("Pearl", [(0.3, "#cfc8c0"), (0.7, "#f2ece2")], 20, 0.3, speckle=0.1)
    dark = wood("Rest", "#2a1a10", "#4a2f1c")
    steps, sides, growth = 150, 40, 0.175
    rings = []
    for t in np.linspace(-2.6 * pi, 0.0, steps):
        size = exp(growth * t)
        middle, thick = 0.098 * size, 0.082 * size
        ring = []
        for a in np.linspace(0, 2 * pi, sides, endpoint=False):
            r = middle + thick * cos(a)
            ring.append((r * cos(t), 0.072 * size * sin(a), r * sin(t)))
        rings.append(ring)
    faces, uvs = [], []
    for i in range(steps - 1):
        for j in range(sides):
            k = (j + 1) % sides
            faces.append((i * sides + j, (i + 1) * sides + j, (i + 1) * sides + k, i * sides + k))
            u, u2, v, v2 = j / sides, (j + 1) / sides, i / (steps - 1), (i + 1) / (steps - 1)
            uvs.append([(u, v), (u, v2), (u2, v2), (u2, v)])
    made = from_arrays("Nautilus", np.array(rings).reshape(-1, 3), faces, uvs, shell)
    throat = np.array(rings[-1]) * 0.97 + np.array([0, 0, -0.02])
    inside = from_arrays("Nautilus throat", throat, [tuple(range(sides))], None, pearl)
    lift = Matrix.Translation((0.0, 0.0, 0.21)) @ Matrix.Rotation(radians(-35), 4, "Y")
    for part in (made, inside):
        part.matrix_world = lift @ part.matrix_basis
    foot = smooth([(0.0005, 0.0), (0.07, 0.0), (0.07, 0.012), (0.025, 0.03), (0.02, 0.05), (0.045, 0.075)], 5)
    return [made, inside, lathe("Rest", foot, dark, 40)]


def guitar() -> Parts:
    """Build an acoustic guitar that leans back, its strings to -Y."""
    spruce = mottled(
        "Spruce", [(0.3, "#b97f3a"), (0.5, "#dba65a"), (0.7, "#e8bf7c")], 6, 0.35, stretch=(9, 9, 0.7), speckle=0.3
    )
    rosewood = wood("Rosewood", "#2c1710", "#5c3320")
    black, steel = plain("Ebony", "#17120f", 0.4), plain("Strings", "#d8d4c8", 0.3, 0.8)
    ivory = plain("Ivory", "#e8dcc0", 0.5)
    half = smooth(
        [(0.0, 0.0), (0.11, 0.012), (0.182, 0.08), (0.19, 0.16), (0.15, 0.25), (0.12, 0.3), (0.13, 0.36),
         (0.138, 0.41), (0.105, 0.465), (0.035, 0.485), (0.0, 0.485)], 8,
    )  # fmt: skip
    outline = np.vstack([half, (half * [-1, 1])[-2:0:-1]])
    deep = 0.1

    def slab(name: str, shape: np.ndarray, near: float, far: float, stuff: bpy.types.Material) -> bpy.types.Object:
        count = len(shape)
        rows = np.vstack([np.insert(shape, 1, near, axis=1), np.insert(shape, 1, far, axis=1)])
        faces = [tuple(range(count)), tuple(range(2 * count - 1, count - 1, -1))]
        faces += [(k, count + k, count + (k + 1) % count, (k + 1) % count) for k in range(count)]
        return from_arrays(name, rows, faces, None, stuff)

    middle = np.array([0, 0.23])
    parts = [
        slab("Guitar body", outline, -deep + 0.006, 0.0, rosewood),
        slab("Guitar binding", outline, -deep, -deep + 0.006, ivory),
        slab("Guitar top", middle + (outline - middle) * 0.975, -deep - 0.002, -deep + 0.002, spruce),
    ]
    ring = np.linspace(0, 2 * pi, 40, endpoint=False)
    for r, depth, stuff in ((0.066, 0.003, ivory), (0.06, 0.0035, rosewood), (0.05, 0.004, black)):
        hole = np.stack([r * np.cos(ring), 0.325 + r * np.sin(ring)], axis=1)
        parts.append(slab("Sound hole", hole, -deep - depth, -deep, stuff))
    front = -deep - 0.012
    parts += [
        box("Guitar neck", (0.056, 0.03, 0.42), (0, front + 0.012, 0.66), rosewood, 0.006),
        box("Fretboard", (0.056, 0.008, 0.5), (0, front - 0.004, 0.62), black, 0.002),
        box("Headstock", (0.08, 0.02, 0.16), (0, front + 0.012, 0.945), rosewood, 0.008),
        box("Bridge", (0.17, 0.014, 0.028), (0, -deep - 0.008, 0.14), black, 0.004),
        box("Nut", (0.056, 0.012, 0.008), (0, front - 0.006, 0.868), ivory, 0.001),
    ]
    fret = 0.866
    for _ in range(15):
        parts.append(box("Fret", (0.056, 0.003, 0.003), (0, front - 0.009, fret), steel, 0))
        fret -= (fret - 0.14) / 17.8
    for k in range(6):
        x = (k - 2.5) * 0.0085
        path = [(x * 1.2, -deep - 0.016, 0.14), (x, front - 0.013, 0.5), (x, front - 0.011, 0.9)]
        parts.append(tube("String", path, 0.0011, steel, 5))
        side, row = (-1, 1)[k % 2], k // 2
        parts.append(box("Peg", (0.03, 0.012, 0.016), (side * 0.055, front + 0.012, 0.9 + 0.045 * row), ivory, 0.004))
    lean = Matrix.Rotation(radians(-17), 4, "X")
    for part in parts:
        part.matrix_world = lean @ part.matrix_basis
    return parts


def chest() -> Parts:
    """Build a treasure chest: planks, a round lid, iron bands, a lock."""
    timber = wood("Chest wood", "#3f2412", "#875428")
    iron = mottled("Chest iron", [(0.3, "#2f2c2a"), (0.5, "#5c564e"), (0.7, "#7a6a52")], 18, 0.5, 0.5, speckle=0.4)
    brass = bronze("Lock")
    wide, deep, low, top = 0.76, 0.44, 0.3, 0.16
    parts = []
    for k in range(3):
        z = low * (k + 0.5) / 3
        parts.append(box("Chest plank", (wide, deep, low / 3 - 0.004), (0, 0, z), timber, 0.006))
    arc = [(-deep / 2 * cos(a), low + 0.006 + top * sin(a)) for a in np.linspace(0, pi, 17)]

    def lid(name: str, x0: float, x1: float, grow: float, stuff: bpy.types.Material) -> bpy.types.Object:
        centre = np.array([0.0, low])
        shape = [tuple(centre + (np.array(p) - centre) * grow) for p in arc]
        vertices = np.array([(x, y, z) for x in (x0, x1) for y, z in shape])
        count = len(shape)
        faces = [(k, k + 1, count + k + 1, count + k) for k in range(count - 1)]
        faces += [tuple(range(count))[::-1], tuple(range(count, 2 * count))]
        return from_arrays(name, vertices, faces, None, stuff, 25)

    parts.append(lid("Chest lid", -wide / 2, wide / 2, 1.0, timber))
    for x in (-0.33, -0.12, 0.12, 0.33):
        parts.append(lid("Chest band", x - 0.025, x + 0.025, 1.035, iron))
        parts.append(box("Chest strap", (0.05, deep + 0.016, low - 0.01), (x, 0, low / 2), iron, 0.003))
        for z in (0.05, 0.15, 0.25):
            stud = lathe("Stud", [(0.011, 0.0), (0.009, 0.006), (0.0005, 0.009)], brass, 12)
            stud.matrix_world = Matrix.Translation((x, -deep / 2 - 0.008, z)) @ Matrix.Rotation(pi / 2, 4, "X")
            parts.append(stud)
    parts.append(box("Chest rim", (wide + 0.012, deep + 0.012, 0.03), (0, 0, low - 0.01), iron, 0.004))
    parts.append(box("Lock", (0.1, 0.02, 0.12), (0, -deep / 2 - 0.012, low - 0.02), brass, 0.01))
    parts.append(box("Keyhole", (0.012, 0.006, 0.035), (0, -deep / 2 - 0.022, low - 0.04), plain("Hole", "#0c0a08"), 0))
    return parts


def looking_glass() -> Parts:
    """Build a mirror in a carved gilded frame, tilted forward at the top."""
    gilt = mottled("Gilt", [(0.3, "#6d4a1a"), (0.5, "#b98c38"), (0.7, "#dcb65c")], 24, 0.45, 0.4, speckle=0.5, bump=0.5)
    wide, tall = 0.56, 0.8
    parts = [upright("Mirror", wide, tall, -0.025, mirror("Silvered glass", "#e8eceb"))]
    parts += frame(wide, tall, 0.07, gilt)
    for x in np.linspace(-wide / 2, wide / 2, 9):
        for side in (-1, 1):
            knob = lathe("Carving", smooth([(0.028, 0.0), (0.024, 0.012), (0.0005, 0.02)], 4), gilt, 16)
            knob.matrix_world = Matrix.Translation((x, -0.045, side * (tall / 2 + 0.035))) @ Matrix.Rotation(
                pi / 2, 4, "X"
            )
            parts.append(knob)
    for part in parts:
        part.matrix_world = Matrix.Rotation(radians(9), 4, "X") @ part.matrix_basis
    return parts


def clock() -> Parts:
    """Build a station clock: a painted face in a brass rim, facing -Y."""
    face, rim = painted("Dial", pictures.dial(), 0.4, wear=0.1), bronze("Clock rim")
    edge = smooth([(0.27, 0.0), (0.285, 0.03), (0.27, 0.07), (0.245, 0.075), (0.238, 0.05)], 5)
    parts = [lathe("Dial", [(0.24, 0.05), (0.0005, 0.05)], face, 80, planar=True), lathe("Clock rim", edge, rim, 80)]
    for part in parts:
        part.matrix_world = Matrix.Rotation(pi / 2, 4, "X") @ part.matrix_basis
    return parts


def abacus() -> Parts:
    """Build an abacus: beads on thin rods in an upright frame."""
    timber = wood("Abacus frame", "#4a2a14", "#8a5630")
    rod = plain("Rods", "#a89f90", 0.3, 0.7)
    colours = ("#b3261e", "#d9a520", "#2456a0", "#2f7a3c", "#c8641e")
    beads = [mottled(f"Beads {k}", [(0.3, c), (0.7, c)], 30, 0.4, speckle=0.3) for k, c in enumerate(colours)]
    wide, tall = 0.46, 0.42
    parts = [box("Abacus beam", (wide + 0.05, 0.045, 0.035), (0, 0, z), timber, 0.008) for z in (0.02, tall + 0.02)]
    parts += [
        box("Abacus post", (0.03, 0.04, tall), (s * wide / 2, 0, tall / 2 + 0.02), timber, 0.006) for s in (-1, 1)
    ]
    parts += [box("Abacus foot", (0.05, 0.16, 0.025), (s * wide / 2, 0, 0.0125), timber, 0.006) for s in (-1, 1)]
    profile = smooth([(0.006, -0.013), (0.016, -0.011), (0.021, 0.0), (0.016, 0.011), (0.006, 0.013)], 4)
    shape = lathe("Bead", profile, beads[0], 20)
    rng = np.random.default_rng(2)
    for row in range(8):
        z = 0.068 + row * 0.046
        parts.append(tube("Rod", [(-wide / 2, 0, z), (0, 0, z), (wide / 2, 0, z)], 0.0035, rod, 8))
        apart = int(rng.integers(2, 9))
        for k in range(10):
            bead = link("Bead", shape.data.copy())
            bead.data.materials[0] = beads[(row + (k >= 5)) % len(beads)]
            x = -wide / 2 + 0.03 + 0.0275 * k if k < apart else wide / 2 - 0.03 - 0.0275 * (9 - k)
            bead.matrix_world = Matrix.Translation((x, 0, z)) @ Matrix.Rotation(pi / 2, 4, "Y")
            parts.append(bead)
    bpy.data.objects.remove(shape)
    return parts


def vitrine(wide: float, tall: float) -> Parts:
    """Build a glass case with a thin brass frame around an exhibit on z = 0. It has no instance id."""
    brass = bronze("Case frame")
    glass = thin_glass("Case glass", "#cfe0dc", 0.03)
    half = wide / 2
    parts = []
    for side in (-1, 1):
        for pane in (
            box("Pane", (wide, 0.004, tall), (0, side * half, tall / 2), glass, 0),
            box("Pane", (0.004, wide, tall), (side * half, 0, tall / 2), glass, 0),
        ):
            pane[SEEN_THROUGH] = True
            parts.append(pane)
        for other in (-1, 1):
            parts.append(box("Case post", (0.012, 0.012, tall), (side * half, other * half, tall / 2), brass, 0.003))
        for z in (0.006, tall):
            parts.append(box("Case edge", (wide, 0.012, 0.012), (0, side * half, z), brass, 0.003))
            parts.append(box("Case edge", (0.012, wide, 0.012), (side * half, 0, z), brass, 0.003))
    top = box("Pane", (wide, wide, 0.004), (0, 0, tall), glass, 0)
    top[SEEN_THROUGH] = True
    return [*parts, top]


BUILDERS: dict[str, Callable[[], Parts]] = {
    "pitcher": pitcher,
    "crate": crate,
    "bottle": bottle,
    "ball": ball,
    "candelabrum": candelabrum,
    "nautilus": nautilus,
    "guitar": guitar,
    "chest": chest,
    "mirror": looking_glass,
    "clock": clock,
    "abacus": abacus,
}
