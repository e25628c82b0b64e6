# SPDX-License-Identifier: GPL-3.0-or-later
"""Builders of the exhibits, in metres. Each has its own origin and stands on z = 0, or hangs on a wall behind y = 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, sin

import bpy
import numpy as np
from mathutils import Matrix
from studio import materials
from studio.materials import bronze, mottled, painted, plain, wood
from studio.meshes import box, from_arrays, lathe, relief, smooth, tube
from studio.stage import Parts

import pictures


def vase() -> Parts:
    """Build a black-figure amphora with two handles."""
    body = smooth(
        [
            (0.078, 0.0),
            (0.08, 0.018),
            (0.05, 0.04),
            (0.075, 0.1),
            (0.15, 0.22),
            (0.188, 0.34),
            (0.165, 0.44),
            (0.09, 0.5),
            (0.066, 0.54),
            (0.064, 0.6),
            (0.088, 0.635),
            (0.092, 0.655),
            (0.07, 0.66),
            (0.05, 0.6),
        ],
        7,
    )
    clay = painted("Amphora", pictures.amphora(), 0.42, wear=0.3, wear_scale=22)
    black = mottled("Black slip", [(0.3, "#15100e"), (0.7, "#382a22")], 20, 0.42)
    parts = [lathe("Vase", body, clay, 96)]
    for side in (-1, 1):
        path = smooth(
            [
                (side * 0.06, 0, 0.615),
                (side * 0.12, 0, 0.63),
                (side * 0.172, 0, 0.585),
                (side * 0.178, 0, 0.51),
                (side * 0.14, 0, 0.44),
            ],
            8,
        )
        parts.append(tube("Vase handle", path, 0.015, black, flatten=1.5))
    return parts


def teapot() -> Parts:
    """Build a porcelain teapot with spout, handle and lid."""
    china = painted("Porcelain", pictures.porcelain(), 0.3, wear=0.08)
    blue = mottled("Cobalt", [(0.3, "#182f74"), (0.7, "#3a62c0")], 30, 0.3)
    white = mottled("Glaze", [(0.3, "#e4e0d4"), (0.7, "#f6f3ea")], 18, 0.3, speckle=0.1)
    gold = plain("Gilding", "#c99a3d", 0.35, 0.7)
    body = smooth(
        [
            (0.09, 0.0),
            (0.095, 0.012),
            (0.088, 0.02),
            (0.14, 0.055),
            (0.172, 0.115),
            (0.16, 0.175),
            (0.11, 0.222),
            (0.082, 0.232),
            (0.078, 0.24),
        ],
        7,
    )
    lid = smooth([(0.088, 0.238), (0.087, 0.248), (0.06, 0.266), (0.022, 0.276)], 6)
    knob = smooth([(0.014, 0.272), (0.012, 0.284), (0.027, 0.3), (0.022, 0.318), (0.0005, 0.326)], 6)
    spout = smooth(
        [(0.14, 0, 0.075), (0.2, 0, 0.095), (0.235, 0, 0.15), (0.255, 0, 0.205), (0.295, 0, 0.235)], 8
    )
    handle = smooth(
        [
            (-0.125, 0, 0.2),
            (-0.19, 0, 0.228),
            (-0.255, 0, 0.2),
            (-0.262, 0, 0.14),
            (-0.21, 0, 0.085),
            (-0.15, 0, 0.07),
        ],
        8,
    )
    rim = [(0.086, 0.234), (0.091, 0.238), (0.091, 0.243), (0.086, 0.247)]
    return [
        lathe("Teapot", body, china),
        lathe("Teapot lid", lid, blue),
        lathe("Teapot knob", knob, gold, 40),
        lathe("Teapot rim", rim, gold),
        tube("Teapot spout", spout, np.linspace(0.042, 0.015, len(spout)), white, 20),
        tube("Teapot handle", handle, 0.014, blue, 16),
    ]


def obelisk() -> Parts:
    """Build a carved sandstone obelisk on a stepped base."""
    stone = mottled("Sandstone", [(0.3, "#9a7850"), (0.55, "#c9a777"), (0.75, "#dcc197")], 10, 0.85, bump=0.4)
    base, shoulder, foot, top, tip = 0.13, 0.088, 0.13, 0.84, 0.99
    parts = [
        box("Obelisk step", (0.38, 0.38, 0.06), (0, 0, 0.03), stone),
        box("Obelisk base", (0.31, 0.31, 0.07), (0, 0, 0.095), stone),
    ]
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    for k in range(4):
        (ax, ay), (bx, by) = corners[k], corners[(k + 1) % 4]
        low = [(ax * base, ay * base, foot), (bx * base, by * base, foot)]
        high = [(bx * shoulder, by * shoulder, top), (ax * shoulder, ay * shoulder, top)]
        carving = painted(f"Carving {k}", pictures.hieroglyphs(320, 1100, k), 0.85, wear=0.3, bump=0.6)
        side = [[(0, 0), (1, 0), (1, 1), (0, 1)]]
        parts.append(from_arrays(f"Obelisk face {k}", np.array(low + high), [(0, 1, 2, 3)], side, carving))
        roof = np.array([high[1], high[0], (0, 0, tip)])
        parts.append(from_arrays(f"Obelisk tip {k}", roof, [(0, 1, 2)], None, stone))
    return parts


def shield() -> Parts:
    """Build a round bronze shield with a boss and rivets, facing -Y."""
    front = [
        (0.0005, 0.15),
        (0.03, 0.145),
        (0.06, 0.12),
        (0.078, 0.088),
        (0.1, 0.082),
        (0.22, 0.062),
        (0.315, 0.03),
    ]
    profile = np.vstack(
        [smooth(front, 6), [(0.32, 0.038), (0.345, 0.04), (0.37, 0.034), (0.375, 0.015), (0.36, 0.0)]]
    )
    face = painted("Shield", pictures.sunburst(), 0.42, 0.55, wear=0.5, bump=0.5)
    metal = bronze("Rivets")
    parts = [lathe("Shield", profile, face, 112, planar=True)]
    for k in range(24):
        angle = 2 * pi * k / 24
        stud = lathe("Rivet", [(0.013, 0.0), (0.012, 0.006), (0.007, 0.011), (0.0005, 0.013)], metal, 14)
        stud.location = (0.352 * cos(angle), 0.352 * sin(angle), 0.037)
        parts.append(stud)
    return turned(parts)


def turned(parts: Parts) -> Parts:
    """Rotate parts about X by 90 degrees, so that +Z becomes -Y and +Y becomes +Z."""
    for part in parts:
        part.matrix_world = Matrix.Rotation(pi / 2, 4, "X") @ part.matrix_basis
    return parts


def hourglass() -> Parts:
    """Build a sand glass in a turned wooden frame."""
    timber = wood("Mahogany", "#3f1d10", "#7d4423")
    sand = mottled("Sand", [(0.3, "#d28c30"), (0.7, "#f2bc62")], 60, 0.95, speckle=0.5, bump=0.4)
    glass = materials.thin_glass("Bulb", "#b4c4c0", 0.05)
    disc = [(0.0005, 0.0), (0.128, 0.0), (0.138, 0.008), (0.138, 0.026), (0.12, 0.036), (0.0005, 0.036)]
    bulb = smooth(
        [
            (0.05, 0.037),
            (0.078, 0.07),
            (0.09, 0.12),
            (0.07, 0.178),
            (0.022, 0.216),
            (0.009, 0.23),
            (0.022, 0.244),
            (0.07, 0.282),
            (0.09, 0.34),
            (0.078, 0.39),
            (0.05, 0.423),
        ],
        6,
    )
    heap = smooth([(0.046, 0.038), (0.074, 0.07), (0.084, 0.108), (0.05, 0.135), (0.0005, 0.155)], 6)
    rest = smooth(
        [(0.005, 0.232), (0.02, 0.246), (0.064, 0.282), (0.078, 0.312), (0.04, 0.308), (0.0005, 0.3)], 6
    )
    post = smooth(
        [
            (0.011, 0.034),
            (0.015, 0.06),
            (0.01, 0.08),
            (0.017, 0.14),
            (0.011, 0.2),
            (0.018, 0.23),
            (0.011, 0.26),
            (0.017, 0.32),
            (0.01, 0.38),
            (0.015, 0.4),
            (0.011, 0.426),
        ],
        4,
    )
    top = lathe("Hourglass top", disc, timber)
    top.location.z = 0.424
    parts = [lathe("Hourglass foot", disc, timber), top]
    parts += [
        lathe("Hourglass bulb", bulb, glass),
        lathe("Hourglass heap", heap, sand),
        lathe("Hourglass rest", rest, sand),
    ]
    parts.append(tube("Hourglass stream", [(0, 0, 0.15), (0, 0, 0.19), (0, 0, 0.235)], 0.003, sand, 8))
    for k in range(4):
        column = lathe("Hourglass post", post, timber, 20)
        column.location = (0.112 * cos(pi / 4 + k * pi / 2), 0.112 * sin(pi / 4 + k * pi / 2), 0)
        parts.append(column)
    return parts


def mask() -> Parts:
    """Build a painted theatre mask with open eyes and mouth, facing -Y."""

    def hill(x: np.ndarray, z: np.ndarray, cx: float, cz: float, rx: float, rz: float) -> np.ndarray:
        return np.exp(-(((x - cx) / rx) ** 2) - ((z - cz) / rz) ** 2)

    def outline(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        width = np.where(z > 0, 0.98 - 0.1 * z**2, 0.98 - 0.42 * z**2)
        return (x / width) ** 2 + (np.abs(z) / 0.98) ** 2.6

    def depth(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        face = 0.135 * np.sqrt(np.clip(1.12 - outline(x, z), 0, 1.2))
        a = np.abs(x)
        bridge = np.clip((0.42 - z) / 0.65, 0, 1) * (z > -0.3) * np.exp(-((x / 0.13) ** 2))
        face += 0.058 * bridge + 0.022 * hill(a, z, 0.12, -0.2, 0.11, 0.1)
        face += 0.026 * hill(a, z, 0.38, 0.4, 0.34, 0.1) + 0.022 * hill(a, z, 0.5, -0.2, 0.26, 0.22)
        face -= 0.03 * hill(a, z, 0.37, 0.15, 0.24, 0.15)
        face += 0.022 * hill(x, z, 0, -0.5, 0.45, 0.22) + 0.026 * hill(x, z, 0, -0.84, 0.3, 0.14)
        return face + 0.016 * (z > 0.64)

    def inside(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        eyes = ((np.abs(x) - 0.37) / 0.16) ** 2 + ((z - 0.15) / 0.075) ** 2 > 1
        mouth = (x / 0.27) ** 2 + ((z + 0.52) / 0.075) ** 2 > 1
        return (outline(x, z) < 1) & eyes & mouth

    paint = painted("Mask", pictures.face(), 0.5, wear=0.3, wear_scale=25)
    return [relief("Mask", depth, inside, 0.21, 0.29, 0.012, paint)]


def goblet() -> Parts:
    """Build a gold goblet set with stones."""
    stops = [(0.3, "#8e6120"), (0.5, "#d9a53f"), (0.7, "#f0cb70")]
    gold = mottled("Gold", stops, 26, 0.36, 0.75, speckle=0.4, speckle_scale=120, bump=0.5)
    profile = smooth(
        [
            (0.0005, 0.0),
            (0.1, 0.0),
            (0.104, 0.01),
            (0.085, 0.022),
            (0.035, 0.045),
            (0.018, 0.07),
            (0.016, 0.1),
            (0.036, 0.118),
            (0.036, 0.13),
            (0.016, 0.148),
            (0.02, 0.172),
            (0.066, 0.2),
            (0.092, 0.25),
            (0.098, 0.32),
            (0.106, 0.352),
            (0.101, 0.356),
            (0.092, 0.32),
            (0.084, 0.25),
            (0.04, 0.205),
            (0.0005, 0.2),
        ],
        6,
    )
    parts = [lathe("Goblet", profile, gold)]
    stones = [plain(f"Gem {k}", colour, 0.2) for k, colour in enumerate(("#9c0f1c", "#0d5c3a", "#143a8c"))]
    bead = smooth([(0.016, 0.0), (0.0145, 0.006), (0.009, 0.01), (0.0005, 0.011)], 4)
    for radius, height, count in ((0.095, 0.285, 9), (0.035, 0.124, 6), (0.062, 0.03, 8)):
        for k in range(count):
            angle = 2 * pi * k / count
            gem = lathe("Goblet gem", bead * (1.0 if count == 9 else 0.6), stones[k % 3], 16)
            gem.rotation_euler = (0, pi / 2 if radius > 0.09 or height > 0.1 else 0.5, angle)
            gem.location = (radius * cos(angle), radius * sin(angle), height)
            parts.append(gem)
    for height, radius in ((0.31, 0.0985), (0.258, 0.0945), (0.345, 0.1055)):
        ring = [(radius * cos(t), radius * sin(t), height) for t in np.linspace(0, 2 * pi, 60)]
        parts.append(tube("Goblet ring", ring, 0.0035, gold, 8))
    return parts


def bell() -> Parts:
    """Build a bronze bell hanging in a wooden frame."""
    metal, timber = bronze("Bell bronze"), wood("Oak", "#4a2f18", "#93653a")
    profile = smooth(
        [
            (0.16, 0.1),
            (0.168, 0.112),
            (0.15, 0.14),
            (0.118, 0.21),
            (0.103, 0.29),
            (0.094, 0.35),
            (0.07, 0.388),
            (0.0005, 0.4),
        ],
        7,
    )
    inner = [(0.0005, 0.37), (0.08, 0.35), (0.1, 0.2), (0.14, 0.12), (0.16, 0.1)]
    parts = [lathe("Bell", np.vstack([inner, profile]), metal, 96)]
    for height, radius in ((0.15, 0.146), (0.163, 0.139), (0.3, 0.103), (0.313, 0.1015), (0.345, 0.0965)):
        ring = [(radius * cos(t), radius * sin(t), height) for t in np.linspace(0, 2 * pi, 80)]
        parts.append(tube("Bell band", ring, 0.0045, metal, 10))
    parts.append(
        lathe(
            "Clapper",
            smooth([(0.0005, 0.065), (0.024, 0.08), (0.024, 0.105), (0.009, 0.13), (0.008, 0.3)], 4),
            metal,
            24,
        )
    )
    loop = [(0.035 * cos(t), 0, 0.415 + 0.035 * sin(t)) for t in np.linspace(-0.4, pi + 0.4, 24)]
    parts.append(tube("Bell loop", loop, 0.012, metal, 12))
    parts.append(box("Bell beam", (0.56, 0.055, 0.06), (0, 0, 0.48), timber))
    parts.append(box("Bell sill", (0.54, 0.2, 0.035), (0, 0, 0.0175), timber))
    for side in (-1, 1):
        parts.append(box("Bell post", (0.045, 0.06, 0.43), (side * 0.225, 0, 0.24), timber))
        brace = box("Bell brace", (0.03, 0.04, 0.14), (0, 0, 0), timber)
        brace.location, brace.rotation_euler = (side * 0.175, 0, 0.42), (0, side * -0.8, 0)
        parts.append(brace)
    return parts


def flowerpot() -> Parts:
    """Build a terracotta pot with a flowering plant."""
    clay = mottled(
        "Terracotta", [(0.3, "#8f4a2c"), (0.5, "#b9643c"), (0.7, "#cf8a62")], 14, 0.85, speckle=0.4, bump=0.3
    )
    soil = mottled("Soil", [(0.3, "#1e140d"), (0.7, "#47321f")], 60, 0.95, bump=0.8)
    leaf = mottled("Leaf", [(0.3, "#27511f"), (0.55, "#447a32"), (0.75, "#79a24e")], 30, 0.5)
    petals = [
        mottled(f"Petal {k}", [(0.3, a), (0.7, b)], 40, 0.6)
        for k, (a, b) in enumerate((("#a3122a", "#d8384a"), ("#c4405e", "#ec8aa0")))
    ]
    profile = smooth([(0.0005, 0.0), (0.105, 0.0), (0.112, 0.01), (0.155, 0.215)], 4).tolist()
    profile += [(0.175, 0.217), (0.182, 0.226), (0.184, 0.275), (0.178, 0.284), (0.162, 0.284), (0.158, 0.25)]
    parts = [
        lathe("Flowerpot", profile, clay),
        lathe("Soil", [(0.16, 0.255), (0.08, 0.268), (0.0005, 0.27)], soil, 40),
    ]
    rng = np.random.default_rng(9)
    for k in range(64):
        turn, lean = k * 2.39996, 0.15 + 1.25 * (k / 64) ** 0.8
        reach = rng.uniform(0.85, 1.1) * (0.3 - 0.07 * k / 64)
        parts.append(blade(turn, lean, reach, 0.036 + 0.014 * rng.random(), leaf))
    for k in range(9):
        turn, spread = k * 2.39996 + 0.5, 0.05 + 0.11 * (k / 9) ** 0.5
        head = np.array(
            [spread * cos(turn), spread * sin(turn), 0.6 - 1.9 * spread**1.4 + 0.02 * rng.standard_normal()]
        )
        stem = smooth([(0.3 * head[0], 0.3 * head[1], 0.27), (0.6 * head[0], 0.6 * head[1], 0.42), head], 5)
        parts.append(tube("Flower stem", stem, 0.005, leaf, 8))
        for j in range(12):
            around, tilt = j * 2.39996, 0.3 + 1.2 * j / 12
            parts.append(blade(around, tilt, 0.052, 0.026, petals[k % 2], head, curl=0.3))
    return parts


def blade(
    turn: float,
    lean: float,
    reach: float,
    width: float,
    material: bpy.types.Material,
    root: Sequence[float] = (0.0, 0.0, 0.265),
    curl: float = 0.9,
) -> bpy.types.Object:
    """Make one leaf or petal: a strip that starts upright, leans out and curls over."""
    steps = 9
    out, across = np.array([cos(turn), sin(turn), 0.0]), np.array([-sin(turn), cos(turn), 0.0])
    spine, vertices = np.array(root), []
    for i in range(steps + 1):
        t = i / steps
        angle = lean * 0.6 + curl * t * lean
        half = width * sin(pi * (0.08 + 0.92 * t) ** 0.8) + 0.002
        sag = np.array([0, 0, 0.25 * half])
        vertices += [spine - across * half + sag, spine, spine + across * half + sag]
        spine = spine + (out * sin(angle) + np.array([0, 0, cos(angle)])) * reach / steps
    faces = [(3 * i + j, 3 * i + j + 1, 3 * i + j + 4, 3 * i + j + 3) for i in range(steps) for j in (0, 1)]
    return from_arrays("Leaf", np.array(vertices), faces, None, material, crease=80)


def drum() -> Parts:
    """Build a painted side drum with hoops and tension ropes."""
    shell = painted("Drum shell", pictures.drum_shell(), 0.45, wear=0.3)
    hide = mottled("Drum skin", [(0.3, "#c9b48c"), (0.55, "#e6d7b4"), (0.75, "#efe5c8")], 7, 0.7, speckle=0.3)
    hoop = wood("Hoops", "#1d3040", "#35566b")
    rope = mottled("Rope", [(0.3, "#b9a777"), (0.7, "#ebdfba")], 90, 0.9, bump=0.6)
    leather = mottled("Leather", [(0.3, "#4c2d18"), (0.7, "#7f5230")], 30, 0.7)
    radius, tall = 0.21, 0.36
    parts = [
        lathe("Drum", [(radius, 0.02), (radius, tall - 0.02)], shell, 96),
        lathe(
            "Drum skin",
            [
                (radius + 0.006, tall - 0.03),
                (radius + 0.006, tall - 0.004),
                (radius - 0.01, tall),
                (0.0005, tall),
            ],
            hide,
            96,
        ),
    ]
    for low in (0.0, tall - 0.055):
        ring = [
            (radius + 0.004, low),
            (radius + 0.024, low),
            (radius + 0.026, low + 0.004),
            (radius + 0.026, low + 0.046),
            (radius + 0.022, low + 0.05),
            (radius + 0.004, low + 0.05),
        ]
        parts.append(lathe("Drum hoop", ring, hoop, 96))
    count = 20
    for k in range(count):
        a, b = 2 * pi * k / count, 2 * pi * (k + 1) / count
        r, (low, high) = radius + 0.02, (0.045, tall - 0.05)
        ends = (low, high) if k % 2 else (high, low)
        # A straight line between two points of the hoops would cut into the shell.
        path = [
            (r * cos(a + (b - a) * t), r * sin(a + (b - a) * t), ends[0] + (ends[1] - ends[0]) * t)
            for t in np.linspace(0, 1, 5)
        ]
        parts.append(tube("Drum rope", path, 0.0055, rope, 8))
        if k % 2 == 0:
            tug = [(r * cos(a), r * sin(a), z) for z in (0.09, 0.12, 0.15)]
            parts.append(tube("Drum tug", tug, 0.015, leather, 10))
    hickory = wood("Hickory", "#8a5a2c", "#c08a50")
    for side, z in ((-1, tall + 0.01), (1, tall + 0.028)):
        stick = np.linspace((-0.18, -0.1 * side, z), (0.18, 0.08 * side, z), 9)
        parts.append(tube("Drumstick", stick, np.linspace(0.011, 0.007, 9), hickory, 12))
    return parts


BUILDERS: dict[str, Callable[[], Parts]] = {
    "vase": vase,
    "teapot": teapot,
    "obelisk": obelisk,
    "shield": shield,
    "hourglass": hourglass,
    "mask": mask,
    "goblet": goblet,
    "bell": bell,
    "flowerpot": flowerpot,
    "drum": drum,
}
