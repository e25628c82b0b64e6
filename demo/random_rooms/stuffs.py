# SPDX-License-Identifier: GPL-3.0-or-later
"""Descriptions of materials, and random draws of them. `build` makes Blender's materials of the descriptions."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Stops = tuple[tuple[float, str], ...]
Rng = np.random.Generator
Value = TypeVar("Value")


@dataclass(frozen=True)
class Mottled:
    """Stone, metal, wood, clay or cloth; see `studio.materials.mottled`."""

    stops: Stops
    scale: float = 10.0
    roughness: float = 0.7
    metallic: float = 0.0
    distortion: float = 0.0
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)
    speckle: float = 0.3
    speckle_scale: float = 90.0
    bump: float = 0.15


@dataclass(frozen=True)
class Painted:
    """A surface with a picture: a pattern of `pictures.PATTERNS` in these colours, drawn with a seed."""

    pattern: str
    colours: tuple[str, ...]
    seed: int
    size: tuple[int, int] = (512, 512)
    roughness: float = 0.5
    metallic: float = 0.0
    wear: float = 0.2
    wear_scale: float = 14.0
    bump: float = 0.0


@dataclass(frozen=True)
class Plain:
    """One colour, for small parts."""

    colour: str
    roughness: float = 0.6
    metallic: float = 0.0


@dataclass(frozen=True)
class Glass:
    """Thin glass; `veil` is how much of it is seen where it faces the viewer. `hidden` panes are not in the masks."""

    tint: str
    veil: float = 0.06
    hidden: bool = False


@dataclass(frozen=True)
class Pictured:
    """A surface with a picture of a file in a ZIP archive."""

    archive: str
    entry: str
    roughness: float = 0.6


Stuff = Mottled | Painted | Plain | Glass | Pictured


def pick(rng: Rng, values: tuple[Value, ...]) -> Value:
    """Return one of the values."""
    return values[int(rng.integers(len(values)))]


def uniform(rng: Rng, low: float, high: float) -> float:
    """Return a number between two others."""
    return float(rng.uniform(low, high))


def new_seed(rng: Rng) -> int:
    """Return a seed for a picture."""
    return int(rng.integers(2**31))


def tone(hue: float, saturation: float, value: float) -> str:
    """Return '#rrggbb' of a hue in degrees, and a saturation and a value in 0..1, which are clipped."""
    rgb = colorsys.hsv_to_rgb(hue % 360 / 360, min(max(saturation, 0.0), 1.0), min(max(value, 0.0), 1.0))
    return "#" + "".join(f"{round(255 * c):02x}" for c in rgb)


def any_tone(rng: Rng, value: tuple[float, float] = (0.35, 0.8), saturation: tuple[float, float] = (0.3, 0.8)) -> str:
    """Return a colour of any hue."""
    return tone(uniform(rng, 0, 360), uniform(rng, *saturation), uniform(rng, *value))


def shades(rng: Rng, hue: float, saturation: float, value: float, contrast: float = 0.35) -> Stops:
    """Return four colour stops around a colour; their values differ by up to `contrast` of it."""
    stops = []
    for position, factor in ((0.3, -1.0), (0.47, 0.35), (0.56, -0.25), (0.74, 1.0)):
        stops.append(
            (
                position,
                tone(
                    hue + uniform(rng, -8, 8),
                    saturation * uniform(rng, 0.8, 1.1),
                    value * (1 + 0.7 * contrast * factor * uniform(rng, 0.7, 1.2)),
                ),
            )
        )
    return tuple(stops)


def wood(rng: Rng) -> Mottled:
    """Draw a wood, from pale pine to dark walnut."""
    value = uniform(rng, 0.24, 0.68)
    stops = shades(rng, uniform(rng, 18, 36), uniform(rng, 0.45, 0.7), value, 0.5)
    stretch = pick(rng, ((5.0, 5.0, 0.8), (0.8, 5.0, 5.0), (4.0, 4.0, 1.2)))
    return Mottled(stops, uniform(rng, 5, 10), 0.5, distortion=0.6, stretch=stretch, speckle=0.45, bump=0.1)


def stone(rng: Rng) -> Mottled:
    """Draw marble with veins, sandstone or granite."""
    kind = pick(rng, ("marble", "marble", "sandstone", "granite"))
    if kind == "marble":
        value = uniform(rng, 0.3, 0.85)
        hue, saturation = pick(rng, ((40.0, 0.1), (150.0, 0.25), (15.0, 0.4), (215.0, 0.15)))
        stops = list(shades(rng, hue, saturation, value, 0.2))
        stops.insert(2, (0.51, tone(hue, saturation * 0.6, value * (0.45 if value > 0.5 else 1.9))))
        return Mottled(tuple(stops), uniform(rng, 3, 7), 0.4, distortion=1.7, speckle=0.2, bump=0.05)
    if kind == "sandstone":
        stops = shades(rng, uniform(rng, 25, 42), uniform(rng, 0.25, 0.45), uniform(rng, 0.6, 0.8))
        return Mottled(stops, uniform(rng, 8, 14), 0.85, speckle=0.4, bump=0.4)
    stops = shades(rng, uniform(rng, 0, 360), 0.08, uniform(rng, 0.3, 0.6), 0.7)
    return Mottled(stops, uniform(rng, 30, 50), 0.45, speckle=0.5, speckle_scale=150)


def metal(rng: Rng) -> Mottled:
    """Draw gold, brass, bronze, silver, copper or iron."""
    hue, saturation, value, shine = pick(
        rng,
        (
            (42.0, 0.66, 0.85, 0.7),
            (40.0, 0.6, 0.72, 0.6),
            (30.0, 0.6, 0.52, 0.6),
            (210.0, 0.05, 0.78, 0.6),
            (18.0, 0.6, 0.66, 0.6),
            (30.0, 0.12, 0.34, 0.5),
        ),
    )
    stops = shades(rng, hue, saturation, value, 0.3)
    return Mottled(stops, uniform(rng, 9, 26), uniform(rng, 0.36, 0.5), shine, speckle=0.35, bump=0.25)


def glaze(rng: Rng) -> Mottled:
    """Draw a glaze or a paint of any hue."""
    stops = shades(rng, uniform(rng, 0, 360), uniform(rng, 0.2, 0.7), uniform(rng, 0.35, 0.85), 0.4)
    return Mottled(stops, uniform(rng, 8, 24), uniform(rng, 0.28, 0.5), distortion=uniform(rng, 0, 1.5), bump=0.05)


def paint(rng: Rng) -> Mottled:
    """Draw the muted paint of furniture."""
    stops = shades(rng, uniform(rng, 0, 360), uniform(rng, 0.05, 0.4), uniform(rng, 0.3, 0.8), 0.3)
    return Mottled(stops, uniform(rng, 6, 14), uniform(rng, 0.45, 0.7), bump=0.05)


def clay(rng: Rng) -> Mottled:
    """Draw fired clay."""
    stops = shades(rng, uniform(rng, 10, 32), uniform(rng, 0.45, 0.7), uniform(rng, 0.45, 0.8), 0.4)
    return Mottled(stops, uniform(rng, 9, 16), 0.85, speckle=0.4, bump=0.3)


def cloth(rng: Rng) -> Mottled:
    """Draw a woven cloth, leather or felt."""
    stops = shades(rng, uniform(rng, 0, 360), uniform(rng, 0.3, 0.75), uniform(rng, 0.3, 0.7), 0.35)
    return Mottled(stops, uniform(rng, 20, 40), 0.9, speckle=0.5, speckle_scale=200, bump=0.4)


def hard(rng: Rng) -> Mottled:
    """Draw wood, stone, metal or clay."""
    return pick(rng, (wood, stone, metal, clay))(rng)


def ink(rng: Rng) -> tuple[str, ...]:
    """Draw four colours of a decoration: a ground, a darker or lighter figure, and two accents."""
    hue = uniform(rng, 0, 360)
    pale = rng.random() < 0.55
    ground = tone(hue, uniform(rng, 0.1, 0.6), uniform(rng, 0.7, 0.9) if pale else uniform(rng, 0.25, 0.45))
    figure = tone(
        hue + uniform(rng, 120, 240),
        uniform(rng, 0.3, 0.8),
        uniform(rng, 0.15, 0.35) if pale else uniform(rng, 0.75, 0.9),
    )
    accents = (any_tone(rng, (0.45, 0.75), (0.5, 0.85)), any_tone(rng, (0.45, 0.75), (0.5, 0.85)))
    return (ground, figure, *accents)


def decorated(rng: Rng, patterns: tuple[str, ...], size: tuple[int, int] = (512, 1024), **options: float) -> Painted:
    """Draw a surface with one of the patterns."""
    return Painted(pick(rng, patterns), ink(rng), new_seed(rng), size, **options)


def brightness(stuff: Stuff) -> float:
    """Return the mean linear luminance of the colours of a surface, in 0..1."""
    colours = (
        [c for _, c in stuff.stops] if isinstance(stuff, Mottled) else list(getattr(stuff, "colours", ("#808080",)))
    )
    values = np.array([[int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)] for colour in colours])
    return float((values**2.2 @ [0.2126, 0.7152, 0.0722]).mean())


def darker(stuff: Mottled, factor: float) -> Mottled:
    """Return the same material with values multiplied by a factor."""
    stops = []
    for position, colour in stuff.stops:
        rgb = [min(255, round(int(colour[k : k + 2], 16) * factor)) for k in (1, 3, 5)]
        stops.append((position, "#" + "".join(f"{c:02x}" for c in rgb)))
    return Mottled(tuple(stops), *(getattr(stuff, name) for name in list(stuff.__dataclass_fields__)[1:]))
