# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of a room: everything that a seed decides, without Blender."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np
from studio.phone import Phone
from studio.shapes import quad
from studio.views import View
from studio.views import plan as plan_views

from .catalogue import OWN, Catalogue, Kind
from .layout import Dimensions, Exhibit, Layout, NoRoomError, Placed, fits_inside
from .sight import draw_walks, estimated_pixels, eye_of, is_walkable
from .stuffs import (
    Mottled,
    Painted,
    Rng,
    Stuff,
    any_tone,
    brightness,
    new_seed,
    pick,
    shades,
    stone,
    tone,
    uniform,
    wood,
)
from .things import Part, Thing

PHONE = Phone(width=480, height=360, margin=10, quality=75, subsampling=2)
PHOTOS = 24
FEWEST, MOST = 6, 14
SEEN_PIXELS, SEEN_PHOTOS = 400, 6
"""Every exhibit has this many pixels in this many photos."""
FIRST_FURNITURE = 41
"""Instance id of the first piece of furniture."""
ATTEMPTS_PER_SET = 6
"""Attempts, see `draw_room`, with the same exhibits."""
_REDRAWS, _LAYOUTS, _MOVES = 5, 12, 6
# The estimate of the plan asks for more than the masks must show, because it is coarse.
_MARGIN_PIXELS, _MARGIN_PHOTOS = 700, 8
_ABSENT_KINDS, _ABSENT_EVERYDAY = 6, 4


class RoomError(Exception):
    """No room could be planned for a seed."""


@dataclass(frozen=True)
class Lamp:
    """A rectangular lamp: position, where it points, size in metres, watts and colour."""

    where: tuple[float, float, float]
    aim: tuple[float, float, float]
    wide: float
    tall: float
    watts: float
    colour: str


@dataclass(frozen=True, eq=False)
class RoomPlan:
    """A room and its photos.

    Attributes
    ----------
    seed, attempt
        What the room was drawn from.
    dimensions
        Its size.
    shell
        Floor and walls, whose id is 0.
    exhibits, furniture
        Things at their places. Ids of exhibits count from 1, those of furniture from `FIRST_FURNITURE`.
    lamps, sky
        Lamps; colour and strength of the sky.
    views
        Cameras and exposures of the photos.
    absent
        Words for things that the room does not show.
    """

    seed: int
    attempt: int
    dimensions: Dimensions
    shell: Thing
    exhibits: tuple[Placed, ...]
    furniture: tuple[Placed, ...]
    lamps: tuple[Lamp, ...]
    sky: tuple[str, float]
    views: tuple[View, ...]
    absent: tuple[str, ...]

    def named(self) -> dict[str, dict[str, object]]:
        """Return the content of ``names.json``."""
        names: dict[str, dict[str, object]] = {
            str(k): {"name": one.name, "prompt": one.prompt} for k, one in enumerate(self.exhibits, start=1)
        }
        for k, one in enumerate(self.furniture, start=FIRST_FURNITURE):
            names[str(k)] = {"name": one.name, "prompt": one.prompt, "ignore": True}
        return names

    def fingerprint(self) -> str:
        """Return a hash of everything that the plan decides."""
        digest = hashlib.sha256()
        things = [(self.shell, "shell")] + [
            (one.thing, (one.name, one.prompt, one.where, one.turn)) for one in (*self.exhibits, *self.furniture)
        ]
        for thing, place in things:
            digest.update(repr(place).encode())
            for part in thing.parts:
                digest.update(part.shape.vertices.tobytes() + part.shape.quads.tobytes() + repr(part.stuff).encode())
        for view in self.views:
            digest.update(view.world_to_camera.tobytes() + repr(view.exposure).encode())
        digest.update(repr((self.dimensions, self.lamps, self.sky, self.absent)).encode())
        return digest.hexdigest()


def generator(seed: int, purpose: str, *numbers: int) -> Rng:
    """Return a generator of random numbers for one purpose."""
    return np.random.default_rng((seed, zlib.crc32(purpose.encode()), *numbers))


def draw_room(seed: int, attempt: int = 0, catalogue: Catalogue = OWN) -> RoomPlan:
    """Draw a room.

    Parameters
    ----------
    seed
        Not negative. Decides size, materials, light and exhibits.
    attempt
        Further places and walks, for when an exhibit is seen too little in rendered masks. After each
        `ATTEMPTS_PER_SET` attempts the exhibits are others, too.
    catalogue
        What the exhibits are drawn from.

    Raises
    ------
    RoomError
        When no layout was found.
    """
    first = attempt // ATTEMPTS_PER_SET
    for redraw in range(first, first + _REDRAWS):
        exhibits = _exhibits(generator(seed, "exhibits", redraw), catalogue)
        style = generator(seed, "style")
        room = _dimensions(style, len(exhibits))
        shell = _shell(style, room)
        sky, lamps = _light(style, room, _gain(shell))
        for layout in range(_LAYOUTS):
            rng = generator(seed, "places", redraw, attempt, layout)
            views = plan_views(draw_walks(rng, room), (0.0, 0.0), PHOTOS, new_seed(rng))
            placed = _arranged(rng, room, exhibits, views)
            if placed is not None:
                absent = _absent(generator(seed, "absent", attempt), [one.prompt for one in placed], catalogue)
                return _finished(seed, attempt, room, shell, lamps, sky, views, placed, absent)
    raise RoomError(
        f"No layout was found for seed {seed}, in {_LAYOUTS} tries with each of {_REDRAWS} sets of exhibits."
    )


def _finished(
    seed: int,
    attempt: int,
    room: Dimensions,
    shell: Thing,
    lamps: tuple[Lamp, ...],
    sky: tuple[str, float],
    views: Sequence[View],
    placed: Sequence[Placed],
    absent: tuple[str, ...],
) -> RoomPlan:
    shown = sorted((one for one in placed if one.exhibit is not None), key=lambda one: one.exhibit or 0)
    furniture = tuple(one for one in placed if one.exhibit is None)
    return RoomPlan(seed, attempt, room, shell, tuple(shown), furniture, lamps, sky, tuple(views), absent)


def _arranged(rng: Rng, room: Dimensions, exhibits: Sequence[Exhibit], views: Sequence[View]) -> list[Placed] | None:
    """Return things at places where the photos show every exhibit, or None when none were found."""
    eyes = np.array([eye_of(view) for view in views])
    if not is_walkable(eyes, room):
        return None
    layout = Layout(rng, room, exhibits, eyes)
    try:
        layout.fill()
        for _ in range(_MOVES):
            pixels = estimated_pixels(views, layout.placed, PHONE)
            poor = [k for k, counts in pixels.items() if (counts >= _MARGIN_PIXELS).sum() < _MARGIN_PHOTOS]
            if not poor:
                return layout.placed
            for number in poor:
                layout.move(number)
    except NoRoomError:
        pass
    return None


def _dimensions(rng: Rng, exhibits: int) -> Dimensions:
    """Draw the size of a room, which grows with the number of exhibits."""
    height, crowd = uniform(rng, 2.7, 3.6), (exhibits - FEWEST) / (MOST - FEWEST)
    if exhibits <= 10 and rng.random() < 0.4:
        reach = uniform(rng, 1.2, 1.35) + 0.25 * crowd
        half, back = reach + uniform(rng, 1.35, 1.6), reach + uniform(rng, 1.3, 1.6)
        return Dimensions(half, -back, back, height, True, reach)
    reach = uniform(rng, 1.25, 1.4) + 0.2 * crowd
    half, back = reach + uniform(rng, 1.15, 1.5), uniform(rng, 1.3, 1.7) + 0.3 * crowd
    return Dimensions(half, -reach - 2.3, back, height, False, reach)


# ---- exhibits


def _exhibits(rng: Rng, catalogue: Catalogue) -> list[Exhibit]:
    """Draw kinds and shapes; some are equal twins, and one may be inside another."""
    count = int(rng.integers(FEWEST, MOST + 1))
    most_of = {"wall": 3, "floor": 2 if count < 11 else 3, "surface": count}
    chosen: list[Kind] = []
    for k in rng.permutation(len(catalogue.kinds)).tolist():
        kind = catalogue.kinds[k]
        if sum(one.mount == kind.mount for one in chosen) < most_of[kind.mount] and len(chosen) < count:
            chosen.append(kind)
    things = [kind.draw(np.random.default_rng(new_seed(rng))) for kind in chosen]
    inside: dict[int, int] = {}
    holders = [k for k, thing in enumerate(things) if thing.cavity is not None]
    if not holders and catalogue.holders and rng.random() < 0.5:
        replaced = _last(chosen, "surface")
        holder = pick(rng, tuple(kind for kind in catalogue.kinds if kind.name in catalogue.holders))
        chosen[replaced], things[replaced] = holder, holder.draw(np.random.default_rng(new_seed(rng)))
        holders = [replaced]
    if holders and rng.random() < 0.75:
        _fill(rng, catalogue, holders[0], chosen, things, inside)
    if rng.random() < 0.5:
        free = [
            k
            for k in range(len(chosen))
            if chosen[k].mount == "surface" and things[k].cavity is None and k not in inside
        ]
        # The twin takes the place of another kind, so that the number of exhibits stays.
        if len(free) >= 2:
            first, second = (free[k] for k in rng.permutation(len(free))[:2].tolist())
            chosen[second], things[second] = chosen[first], things[first]
    names = [kind.name for kind in chosen]
    result = []
    for k, (kind, thing) in enumerate(zip(chosen, things, strict=True)):
        name = kind.name if names.count(kind.name) == 1 else f"{kind.name} {names[: k + 1].count(kind.name)}"
        result.append(Exhibit(kind.name, name, kind.mount, thing, inside.get(k)))
    return result


def _last(chosen: Sequence[Kind], mount: str) -> int:
    return max(k for k, kind in enumerate(chosen) if kind.mount == mount)


def _fill(
    rng: Rng, catalogue: Catalogue, holder: int, chosen: list[Kind], things: list[Thing], inside: dict[int, int]
) -> None:
    """Put a small exhibit into the one with number `holder`; another exhibit becomes one that fits, if need be."""
    small = [
        k for k, kind in enumerate(chosen) if kind.small and k != holder and fits_inside(things[k], things[holder])
    ]
    if small:
        inside[small[0]] = holder
        return
    taken = [kind.name for kind in chosen]
    others = [k for k, kind in enumerate(chosen) if kind.mount == "surface" and k != holder]
    candidates = [kind for kind in catalogue.kinds if kind.small and kind.name not in taken]
    for k in rng.permutation(len(candidates)).tolist():
        for _ in range(4):
            thing = candidates[k].draw(np.random.default_rng(new_seed(rng)))
            if fits_inside(thing, things[holder]) and others:
                chosen[others[-1]], things[others[-1]] = candidates[k], thing
                inside[others[-1]] = holder
                return


def _absent(rng: Rng, shown: Sequence[str], catalogue: Catalogue) -> tuple[str, ...]:
    """Draw words for things that are neither in the room nor like something in it."""
    alike = set(shown)
    for name in shown:
        if name in catalogue.kind_of:
            alike.update(catalogue.kind_of[name].like)
    possible = [kind.name for kind in catalogue.kinds if kind.name not in alike and not _is_like_any(kind, shown)]
    kinds = [possible[k] for k in rng.permutation(len(possible))[:_ABSENT_KINDS].tolist()]
    others = [word for word in catalogue.everyday if word not in alike]
    everyday = [others[k] for k in rng.permutation(len(others))[:_ABSENT_EVERYDAY].tolist()]
    return tuple(kinds + everyday)


def _is_like_any(kind: Kind, shown: Sequence[str]) -> bool:
    """Return whether something shown is like a kind."""
    return any(name in kind.like for name in shown)


# ---- floor, walls and light


def _shell(rng: Rng, room: Dimensions) -> Thing:
    """Draw the materials of floor and walls, and build them; the front is open unless the room is an island's."""
    w, back, front, tall = room.half_width, room.back, room.front, room.height
    plain = rng.random() < 0.25
    floor, floor_repeat = _floor(rng, plain)
    parts = [
        Part(
            quad(
                [(-w, front - 1, 0), (w, front - 1, 0), (w, back, 0), (-w, back, 0)],
                (2 * w / floor_repeat, (back - front + 1) / floor_repeat),
            ),
            floor,
        )
    ]
    wall, wall_repeat = _wall(rng, plain)
    dado = stone(rng) if rng.random() < 0.5 else wood(rng)
    dado_height = uniform(rng, 0.5, 1.0) if rng.random() < 0.35 and not plain else 0.0
    sides = [((-w, back), (w, back)), ((-w, front), (-w, back)), ((w, back), (w, front))]
    if room.island:
        sides.append(((w, front), (-w, front)))
    for a, b in sides:
        long = hypot(b[0] - a[0], b[1] - a[1])
        repeat = (long / wall_repeat, tall / wall_repeat)
        parts.append(Part(quad([(*a, 0), (*b, 0), (*b, tall), (*a, tall)], repeat), wall))
        if dado_height:
            # 4 mm in front of the wall.
            inward = np.array([a[1] - b[1], b[0] - a[0]]) / long * 0.004
            c, d = tuple(np.array(a) + inward), tuple(np.array(b) + inward)
            parts.append(Part(quad([(*c, 0), (*d, 0), (*d, dado_height), (*c, dado_height)]), dado))
    low, high = (-w, front - 1, 0.0), (w, back, tall)
    return Thing(tuple(parts), low, high)


def _floor(rng: Rng, plain: bool) -> tuple[Stuff, float]:
    hue, saturation, value = uniform(rng, 15, 45), uniform(rng, 0.15, 0.55), uniform(rng, 0.3, 0.6)
    colours = tuple(tone(hue + uniform(rng, -12, 12), saturation, value * uniform(rng, 0.7, 1.25)) for _ in range(4))
    kind = "streaks" if plain else pick(rng, ("planks", "planks", "tiles", "streaks", "stone"))
    if kind == "stone":
        return stone(rng), 2.0
    options = {"roughness": uniform(rng, 0.5, 0.8), "wear": 0.35, "wear_scale": 3.0}
    return Painted(kind, colours, new_seed(rng), (1024, 1024), **options), uniform(rng, 1.8, 2.6)


def _wall(rng: Rng, plain: bool) -> tuple[Stuff, float]:
    hue, saturation, value = uniform(rng, 0, 360), uniform(rng, 0.05, 0.4), uniform(rng, 0.45, 0.8)
    if plain:
        return Mottled(
            shades(rng, hue, saturation, value, 0.08), 2.0, 0.9, speckle=0.06, speckle_scale=45, bump=0.1
        ), 2.0
    kind = pick(rng, ("plaster", "plaster", "wallpaper", "bricks"))
    if kind == "plaster":
        stops = shades(rng, hue, saturation, value, 0.4)
        return Mottled(
            stops, uniform(rng, 1.8, 3.5), 0.9, distortion=0.5, speckle=0.28, speckle_scale=45, bump=0.4
        ), 2.0
    base = tone(hue, saturation, value)
    colours = [base]
    for _ in range(3):
        colours.append(
            tone(hue + uniform(rng, -40, 40), saturation + uniform(rng, 0, 0.15), value * uniform(rng, 0.6, 1.2))
        )
    if rng.random() < 0.3:
        colours[3] = any_tone(rng)
    options = {"roughness": 0.9, "wear": 0.4, "wear_scale": 2.4}
    return Painted(kind, tuple(colours), new_seed(rng), (768, 768), **options), uniform(rng, 1.2, 2.0)


def _gain(shell: Thing) -> float:
    """Return by how much the light is stronger because floor and walls are dark; a phone would expose for longer."""
    floor, wall = (brightness(part.stuff) for part in shell.parts[:2])
    return float(np.clip(0.38 / (0.06 + (floor + 2 * wall) / 3), 0.95, 1.9))


def _light(rng: Rng, room: Dimensions, gain: float) -> tuple[tuple[str, float], tuple[Lamp, ...]]:
    """Draw the sky, which lights the room through the missing ceiling, a large lamp at one side and a smaller one."""
    warm = tone(uniform(rng, 25, 45), uniform(rng, 0.08, 0.25), 1.0)
    cool = tone(uniform(rng, 200, 225), uniform(rng, 0.02, 0.1), 1.0)
    sky = (cool if rng.random() < 0.7 else warm, gain * uniform(rng, 0.6, 0.9))
    side = pick(rng, (-1, 1))
    x, y = side * uniform(rng, 0.5, 0.85) * room.half_width, uniform(rng, max(room.front + 0.3, -3.2), -1.8)
    z = room.height - 0.1
    if room.island:
        # Above the walls, because a lamp below their top draws the edge of its light on them.
        x, y, z = 0.5 * x, 0.3 * y, room.height + 0.7
    main = Lamp(
        (x, y, z),
        (uniform(rng, -0.3, 0.3), 0.2, 0.9),
        uniform(rng, 0.8, 1.8),
        uniform(rng, 0.8, 1.8),
        gain * uniform(rng, 120, 240),
        warm,
    )
    lamps = [main]
    if rng.random() < 0.7:
        aim = (uniform(rng, -0.5, 0.5), 0.3, 1.0)
        lamps.append(
            Lamp(
                (-side * uniform(rng, 0.2, 1.2), uniform(rng, -0.4, 0.6), room.height + 0.3),
                aim,
                2.0,
                1.0,
                gain * uniform(rng, 30, 80),
                cool,
            )
        )
    return sky, tuple(lamps)
