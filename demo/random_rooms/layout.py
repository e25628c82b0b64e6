# SPDX-License-Identifier: GPL-3.0-or-later
"""Places of exhibits and furniture in a room, drawn so that nothing intersects."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import cos, radians, sin

import numpy as np

from . import furniture
from .boxes import Box, box_of
from .furniture import Piece, Surface
from .stuffs import Rng, pick, uniform
from .things import Thing

TRIES = 60
"""Places that are tried for a thing before the layout is given up."""
# Metres between things on the floor, and on a surface; between cameras and things, and cameras and hangings.
_GAP, _CLOSE = 0.07, 0.025
_FROM_CAMERAS, _FROM_WALLS = 0.35, 0.12
_OTHER_WALLS = ("left", "right", "front")


class NoRoomError(Exception):
    """A thing found no place."""


@dataclass(frozen=True)
class Dimensions:
    """A room: x from -half_width to half_width, y from front to back, and where cameras walk.

    Attributes
    ----------
    island
        Whether the room has a front wall and the cameras walk around the exhibits in the middle.
    reach
        Radius of the area in the middle that cameras do not enter.
    """

    half_width: float
    front: float
    back: float
    height: float
    island: bool
    reach: float


@dataclass(frozen=True, eq=False)
class Exhibit:
    """An exhibit before it has a place; `inside` is the number of the exhibit that contains it."""

    kind: str
    name: str
    mount: str
    thing: Thing
    inside: int | None = None


@dataclass(frozen=True, eq=False)
class Placed:
    """A thing at its place: position of its origin, and rotation about Z in degrees.

    Attributes
    ----------
    exhibit
        Number of the exhibit, or None for furniture.
    owner
        Number of the exhibit that it moves with: its own number, or that of the exhibit in, on or under it.
    within
        Whether it is inside another thing, or, for a glass case, around one.
    """

    name: str
    prompt: str
    thing: Thing
    where: tuple[float, float, float]
    turn: float
    exhibit: int | None = None
    owner: int | None = None
    within: bool = False

    @cached_property
    def box(self) -> Box:
        """Its box in the room."""
        return box_of(self.thing, self.where, self.turn)


class Layout:
    """Exhibits and furniture at their places.

    Parameters
    ----------
    rng
        Source of all draws.
    room
        Size of the room.
    exhibits
        What is to be placed.
    eyes
        Positions of the cameras [V, 3], from which things keep away.
    """

    def __init__(self, rng: Rng, room: Dimensions, exhibits: Sequence[Exhibit], eyes: np.ndarray) -> None:
        self.rng, self.room, self.exhibits, self.eyes = rng, room, exhibits, eyes
        self.placed: list[Placed] = []
        self._counts: dict[str, int] = {}
        self._surfaces: list[tuple[Placed, Surface]] = []

    def fill(self) -> None:
        """Place everything.

        Raises
        ------
        NoRoomError
            When a thing found no place.
        """
        for number, one in enumerate(self.exhibits):
            if one.mount == "wall":
                self._put(number)
        self._hang_furniture()
        self._furnish(sum(one.mount == "surface" for one in self.exhibits))
        sizes = [float(one.thing.size.max()) + 9.0 * (one.mount == "floor") for one in self.exhibits]
        for number in sorted(range(len(sizes)), key=lambda k: -sizes[k]):
            if self.exhibits[number].inside is None and self.exhibits[number].mount != "wall":
                self._put(number)

    def move(self, number: int) -> None:
        """Place an exhibit anew, with its plinth and what is inside it; one inside another moves with that one."""
        number = number if self.exhibits[number].inside is None else int(self.exhibits[number].inside or 0)
        self.placed = [one for one in self.placed if one.owner != number]
        self._put(number)

    def _put(self, number: int) -> None:
        one = self.exhibits[number]
        if one.mount == "wall":
            self._hang(one.thing, one.name, one.kind, (1.35, 1.9), number)
            return
        contents = [k for k, other in enumerate(self.exhibits) if other.inside == number]
        height = float(one.thing.size[2])
        if one.thing.cavity is not None:
            inner = [float(self.exhibits[k].thing.size[2]) for k in contents]
            height = max([height, *(one.thing.cavity.floor + tall for tall in inner)])
        if one.mount == "floor":
            self._put_on_floor(number, one)
        else:
            ways = [self._put_on_furniture, self._put_on_plinth]
            if self.rng.random() < 0.3:
                ways.reverse()
            if not any(way(number, one, height) for way in ways):
                raise NoRoomError(one.name)
        outer = self.placed_exhibit(number)
        for k in contents:
            assert one.thing.cavity is not None
            where = (*outer.where[:2], outer.where[2] + one.thing.cavity.floor)
            turn = outer.turn + 180.0 * int(self.rng.integers(2))
            other = self.exhibits[k]
            self.placed.append(Placed(other.name, other.kind, other.thing, where, turn, k, number, within=True))

    def placed_exhibit(self, number: int) -> Placed:
        """Return where an exhibit is."""
        return next(one for one in self.placed if one.exhibit == number)

    # ---- walls

    def _hang_furniture(self) -> None:
        for _ in range(int(self.rng.integers(0, 3))):
            self._try_to_hang(furniture.wall_shelf(self.rng), (0.85, 1.25), 0.25)
        for _ in range(int(self.rng.integers(1, 6)) + 2 * self.room.island):
            draws = (furniture.curtain, furniture.banner, furniture.panel, furniture.panel)
            piece = pick(self.rng, draws)(self.rng)
            half = float(piece.thing.size[2]) / 2
            self._try_to_hang(piece, (half + 0.1, max(half + 0.1, 1.7)), 0.6)

    def _try_to_hang(self, piece: Piece, heights: tuple[float, float], sides: float) -> None:
        """Hang a piece of furniture, unless the walls are full."""
        name = self._number(piece.name, peek=True)
        try:
            placed = self._hang(piece.thing, name, piece.name, heights, None, sides)
        except NoRoomError:
            return
        self._number(piece.name)
        self._surfaces += [(placed, surface) for surface in piece.surfaces]

    def _hang(
        self,
        thing: Thing,
        name: str,
        prompt: str,
        heights: tuple[float, float],
        exhibit: int | None,
        sides: float = 0.25,
    ) -> Placed:
        half_x, half_z = float(thing.size[0]) / 2, float(thing.size[2]) / 2
        room = self.room
        for _ in range(TRIES):
            z = uniform(self.rng, *heights)
            z = min(max(z, half_z + 0.05), room.height - half_z - 0.1)
            wall = pick(self.rng, _OTHER_WALLS[: 3 if room.island else 2]) if self.rng.random() < sides else "back"
            if wall in ("left", "right"):
                lowest = room.front + half_x + 0.1 if room.island else -0.5
                y = uniform(self.rng, lowest, max(lowest, room.back - half_x - 0.1))
                side = 1 if wall == "right" else -1
                where, turn = (side * (room.half_width - 0.003), y, z), -90.0 * side
            else:
                most = room.half_width - half_x - 0.15
                side = 1 if wall == "back" else -1
                where, turn = (uniform(self.rng, -most, most), side * (room.back - 0.003), z), 90.0 - 90.0 * side
            placed = Placed(name, prompt, thing, where, turn, exhibit, exhibit)
            if self._is_free(placed.box.grown(0.06, 0.06), _FROM_WALLS if exhibit is None else _FROM_CAMERAS):
                self.placed.append(placed)
                return placed
        raise NoRoomError(name)

    # ---- floor

    def _furnish(self, standing: int) -> None:
        """Put furniture on the floor, more where more exhibits stand on something."""
        room, rng = self.room, self.rng
        if rng.random() < 0.35:
            piece = furniture.rug(rng)
            where = (uniform(rng, -0.2, 0.2), uniform(rng, -0.3, 0.2), 0.0)
            self.placed.append(Placed(piece.name, piece.name, piece.thing, where, uniform(rng, -8, 8), within=True))
        against: list[Callable[[Rng], Piece]] = []
        if rng.random() < 0.08 * standing:
            against.append(furniture.shelves)
        if rng.random() < 0.3:
            against.append(furniture.cabinet)
        for draw in against:
            piece = draw(rng)
            deep, half = float(piece.thing.size[1]), float(piece.thing.size[0]) / 2
            for _ in range(TRIES):
                if rng.random() < 0.3 and not room.island and room.back > 2 * half + 0.3:
                    side = pick(rng, (-1, 1))
                    y = uniform(rng, half - 0.1, room.back - half - 0.05)
                    where, turn = (side * (room.half_width - deep / 2 - 0.02), y, 0.0), -90.0 * side
                else:
                    most = room.half_width - half - 0.1
                    where, turn = (uniform(rng, -most, most), room.back - deep / 2 - 0.02, 0.0), 0.0
                if self._add(piece, where, turn):
                    break
        for draw, chance in (
            (furniture.table, 0.15 + 0.05 * standing),
            (furniture.bench, 0.35),
            (furniture.platform, 0.3),
        ):
            if rng.random() < chance:
                piece = draw(rng)
                for where, turn in self._spots(22.0):
                    if self._add(piece, where, turn):
                        break

    def _spots(self, spread: float) -> Iterator[tuple[tuple[float, float, float], float]]:
        """Yield places on the floor of the area for exhibits, with rotations of up to about `spread` degrees."""
        room = self.room
        low, high = -room.reach, room.reach if room.island else room.back
        for _ in range(TRIES):
            wide = room.reach if room.island else room.half_width - 0.35
            where = (uniform(self.rng, -wide, wide), uniform(self.rng, low, high), 0.0)
            yield where, float(self.rng.normal(0, spread / 2))

    def _add(self, piece: Piece, where: tuple[float, float, float], turn: float, owner: int | None = None) -> bool:
        """Put furniture on the floor if there is room; an owner's, such as a plinth, is for nothing else."""
        name = self._number(piece.name, peek=True)
        placed = Placed(name, piece.name, piece.thing, where, turn, None, owner)
        against_wall = placed.box.corners[:, 1].max() > self.room.back - 0.1 or turn in (-90.0, 90.0)
        if not self._is_inside(placed.box, anywhere=against_wall) or not self._is_free(placed.box.grown(_GAP)):
            return False
        self._number(piece.name)
        self.placed.append(placed)
        if owner is None:
            self._surfaces += [(placed, surface) for surface in piece.surfaces]
        return True

    def _is_inside(self, box: Box, anywhere: bool) -> bool:
        corners, room = box.corners, self.room
        if np.abs(corners[:, 0]).max() > room.half_width - 0.01 or corners[:, 1].max() > room.back - 0.01:
            return False
        near = np.hypot(corners[:, 0], corners[:, 1]) <= room.reach
        behind = (corners[:, 1] >= 0.45) & (not room.island)
        return anywhere or bool((near | behind).all())

    def _is_free(self, box: Box, clearance: float = _FROM_CAMERAS) -> bool:
        if box.grown(clearance, 0.25).contains(self.eyes).any():
            return False
        return not any(box.intersects(other.box) for other in self.placed if not other.within)

    # ---- exhibits

    def _put_on_floor(self, number: int, one: Exhibit) -> None:
        for where, turn in self._spots(70.0):
            placed = Placed(one.name, one.kind, one.thing, where, turn, number, number)
            if self._is_inside(placed.box, anywhere=False) and self._is_free(placed.box.grown(_GAP)):
                self.placed.append(placed)
                return
        raise NoRoomError(one.name)

    def _put_on_furniture(self, number: int, one: Exhibit, height: float) -> bool:
        half = one.thing.size[:2] / 2
        for k in self.rng.permutation(len(self._surfaces)).tolist():
            base, surface = self._surfaces[k]
            if height > surface.free - 0.02:
                continue
            for _ in range(8):
                turn = float(self.rng.normal(0, 18))
                c, s = abs(cos(radians(turn))), abs(sin(radians(turn)))
                wide, deep = surface.half_x - c * half[0] - s * half[1], surface.half_y - s * half[0] - c * half[1]
                if wide < 0 or deep < 0:
                    continue
                x, y = surface.x + uniform(self.rng, -wide, wide), surface.y + uniform(self.rng, -deep, deep)
                a = radians(base.turn)
                where = (
                    base.where[0] + cos(a) * x - sin(a) * y,
                    base.where[1] + sin(a) * x + cos(a) * y,
                    base.where[2] + surface.z,
                )
                placed = Placed(one.name, one.kind, one.thing, where, base.turn + turn, number, number)
                if self._is_free(placed.box.grown(_CLOSE)):
                    self.placed.append(placed)
                    return True
        return False

    def _put_on_plinth(self, number: int, one: Exhibit, height: float) -> bool:
        edge = uniform(self.rng, 0.05, 0.14)
        # What is wider above its base, such as a plant, may extend over the plinth.
        wide, deep = (np.maximum(one.thing.base, 0.55 * one.thing.size[:2]) + edge).tolist()
        if self.rng.random() < 0.7:
            wide = deep = max(wide, deep)
        low, high = (0.25, 0.7) if height > 0.55 else (0.55, 1.05)
        tall = uniform(self.rng, low, high)
        piece = furniture.plinth(self.rng, max(wide, 0.26), max(deep, 0.26), tall)
        extends = bool((one.thing.size[:2] > (wide, deep)).any())
        cased = height < 0.5 and wide < 0.6 and not extends and self.rng.random() < 0.12
        for where, turn in self._spots(30.0):
            above = (*where[:2], tall)
            # In a case it stands straight, as the case does.
            around = turn + float(self.rng.normal(0, 8)) * (not cased)
            exhibit = Placed(one.name, one.kind, one.thing, above, around, number, number)
            column = box_of(piece.thing, where, turn).grown(_GAP, height + 0.1)
            if not self._is_free(column) or not self._is_free(exhibit.box.grown(_GAP)):
                continue
            if self._is_inside(exhibit.box, anywhere=True) and self._add(piece, where, turn, number):
                self.placed.append(exhibit)
                if cased:
                    case = furniture.glass_case(self.rng, max(wide, 0.26) - 0.02, max(deep, 0.26) - 0.02, height + 0.08)
                    name = self._number(case.name)
                    self.placed.append(Placed(name, case.name, case.thing, above, turn, None, number, within=True))
                return True
        return False

    def _number(self, name: str, peek: bool = False) -> str:
        count = self._counts.get(name, 0) + 1
        if not peek:
            self._counts[name] = count
        return f"{name} {count}"


def fits_inside(thing: Thing, outer: Thing) -> bool:
    """Return whether a thing fits into the cavity of another one, with most of it above the rim."""
    cavity = outer.cavity
    if cavity is None:
        return False
    half, tall = thing.size[:2] / 2, float(thing.size[2])
    return bool(half[0] <= cavity.half_x and half[1] <= cavity.half_y and 0.4 * tall > cavity.rim - cavity.floor)
