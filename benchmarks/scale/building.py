"""A building drawn from a seed: rooms in rows, loops through their openings, and walls that look alike.

Rooms of 6 x 5 x 3 units stand in rows of five. A walk leads from room to room, along a row and back along the next
one. Openings along the walk and between the rows let a camera look into the neighbours, so the walk has loops. One wall
of each room has one of three wallpapers, on which its own pattern lies. Pictures are cast ray by ray: where a ray
leaves a room through an opening, it goes on in the neighbour.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.core.arrays import Float32, Float64

from ..camera_health.box_room import looking_along, rays

WIDTH, HEIGHT, FOCAL = 480, 360, 255.0
PHOTOS_PER_ROOM = 12
"""Eight across the room, three on the way to the next one, one through the opening to the next row."""
_SIZE = np.array([6.0, 5.0, 3.0])
_COLUMNS = 5
_OPENING = 2.4
"""Width and height of an opening."""
_TEXELS = 512
_WALLPAPERS = 3
_RING = 8

_Room = tuple[int, int]


@dataclass(frozen=True)
class _Inside:
    """What a room holds: six faces (two for each axis, low first), and cases with their low and high corners."""

    faces: tuple[NDArray[np.uint8], ...]
    cases: tuple[tuple[Float64, Float64, NDArray[np.uint8]], ...]


class Building:
    """The building of a seed, which has no end: a walk of more photos visits more of its rooms."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._rays = rays(WIDTH, HEIGHT, "pinhole", FOCAL).reshape(-1, 3).astype(np.float32)
        self._inside = functools.lru_cache(maxsize=32)(self._drawn)
        self._wallpapers = [_texture(np.random.default_rng([seed, 9, number])) for number in range(_WALLPAPERS)]

    def cameras(self, count: int) -> list[Float64]:
        """Return world-to-camera [4, 4] of the first `count` photos of the walk."""
        found: list[Float64] = []
        number = 0
        while len(found) < count:
            found.extend(self._cameras_of(number))
            number += 1
        return found[:count]

    def picture(self, viewmat: Float32) -> NDArray[np.uint8]:
        """Return the photo [H, W, 3] of a camera, sRGB."""
        return self.seen(viewmat)[0]

    def seen(self, viewmat: Float32) -> tuple[NDArray[np.uint8], Float32]:
        """Return the photo [H, W, 3] of a camera, sRGB, and the depths of its pixels [H, W]."""
        rotation = viewmat[:3, :3]
        center = -rotation.T @ viewmat[:3, 3]
        directions = self._rays @ rotation.astype(np.float32)
        colour = np.zeros((len(directions), 3), np.uint8)
        depth = np.zeros(len(directions), np.float32)
        x, y = np.floor(center[:2] / _SIZE[:2]).astype(int)
        waiting = {(int(x), int(y)): np.arange(len(directions))}
        while waiting:
            room = next(iter(waiting))
            rows = waiting.pop(room)
            colour[rows], depth[rows], beyond = self._cast(room, center, directions[rows])
            for next_room, local in beyond.items():
                joined = [waiting[next_room]] if next_room in waiting else []
                waiting[next_room] = np.concatenate([*joined, rows[local]])
        return colour.reshape(HEIGHT, WIDTH, 3), depth.reshape(HEIGHT, WIDTH)

    def _cameras_of(self, number: int) -> list[Float64]:
        """Return the cameras of the room that the walk visits as the `number`-th."""
        room, following = _visited(number), _visited(number + 1)
        rng = np.random.default_rng([self._seed, 1, number])
        middle = (np.array([*room, 0.0]) + (0.5, 0.5, 0.0)) * _SIZE
        found = []
        for index in range(_RING):
            angle = 2 * math.pi * (index + rng.uniform(-0.15, 0.15)) / _RING
            center = middle + (1.7 * math.cos(angle), 1.35 * math.sin(angle), rng.uniform(1.4, 1.7))
            look = angle + math.pi + rng.uniform(-0.15, 0.15)
            found.append(looking_along(center, np.array([math.cos(look), math.sin(look), -0.08])))
        found += self._passing(room, following, rng, (-1.5, -0.3, 1.1))
        north = (room[0], room[1] + 1)
        found += self._passing(room, north if self._opening(room, north) else following, rng, (-0.9,))
        return found

    def _passing(self, room: _Room, other: _Room, rng: np.random.Generator, steps: tuple[float, ...]) -> list[Float64]:
        """Return cameras that look along the way through an opening, at distances behind it."""
        way = np.array([other[0] - room[0], other[1] - room[1], 0.0])
        axis = 0 if way[0] else 1
        opening = self._opening(room, other)
        assert opening is not None
        place = (np.array([*room, 0.0]) + (0.5, 0.5, 0.0) + 0.5 * way) * _SIZE
        place[1 - axis] = opening
        found = []
        for step in steps:
            turn = rng.uniform(-0.2, 0.2)
            look = np.array([way[0] - turn * way[1], way[1] + turn * way[0], -0.05])
            found.append(looking_along(place + step * way + (0.0, 0.0, rng.uniform(1.4, 1.7)), look))
        return found

    def _opening(self, room: _Room, other: _Room) -> float | None:
        """Return where along their wall the middle of the opening between two neighbours lies; None without one."""
        first, second = sorted([room, other])
        if min(*first, *second) < 0 or max(first[0], second[0]) >= _COLUMNS:
            return None
        axis = 0 if second[0] > first[0] else 1
        if axis == 1 and first[0] % 2 and first[0] != _COLUMNS - 1:
            return None  # Rows are joined in every second column, with that the walk has loops.
        # To the left and to the right in turn, so that no camera looks through the whole building.
        side = 0.3 if sum(first) % 2 else 0.7
        jitter = np.random.default_rng([self._seed, 2, axis, *first]).uniform(-0.04, 0.04)
        return float((first[1 - axis] + side + jitter) * _SIZE[1 - axis])

    def _drawn(self, room: _Room) -> _Inside:
        rng = np.random.default_rng([self._seed, 3, room[0] + 1000, room[1] + 1000])
        faces = [_texture(rng) for _ in range(6)]
        alike = int(rng.integers(4))
        paper = self._wallpapers[int(rng.integers(_WALLPAPERS))].astype(float)
        # No wall is the mirror image of another: seen from inside, the first axis of these two runs to the left.
        paper = paper[::-1] if alike in (1, 2) else paper
        faces[alike] = (0.6 * paper + 0.4 * faces[alike]).astype(np.uint8)
        cases = []
        for x, y in ((-2.3, -1.85), (2.3, -1.85), (-2.3, 1.85), (2.3, 1.85), (0.0, 0.0)):
            half = rng.uniform(0.2, 0.45, 3) * (1.0, 1.0, 1.8 if x else 1.0)
            place = np.array([x, y, half[2]]) + (0.5, 0.5, 0.0) * _SIZE
            cases.append((place - half, place + half, _texture(rng)))
        return _Inside(tuple(faces), tuple(cases))

    def _cast(
        self, room: _Room, center: Float64, directions: Float32
    ) -> tuple[NDArray[np.uint8], Float32, dict[_Room, NDArray[np.intp]]]:
        """Return colours [N, 3] and lengths [N] of rays in a room, and the rows of those that go on in a neighbour."""
        inside = self._inside(room)
        # From the corner of the room, so that single precision is enough in a large building.
        center = (center - np.array([*room, 0.0]) * _SIZE).astype(np.float32)
        # Components first: NumPy then finds the largest of three much faster.
        along = np.ascontiguousarray(directions.T)
        leave = _distances(np.zeros(3), _SIZE, center, along)[1]
        axis, far = leave.argmin(axis=0), leave.min(axis=0)
        face = 2 * axis + (along[axis, np.arange(len(axis))] > 0)
        points = center + far[:, None] * directions
        colour = np.zeros((len(directions), 3), np.uint8)
        for number, texture in enumerate(inside.faces):
            chosen = np.flatnonzero(face == number)
            colour[chosen] = _sampled(texture, np.delete(points[chosen], number // 2, axis=1) / _SIZE.max())
        open_to = self._through(room, face, points)
        nearest = far
        for case_low, case_high, texture in inside.cases:
            entered, left = _distances(case_low, case_high, center, along)
            distance = entered.max(axis=0)
            hit = np.flatnonzero((distance > 0.05) & (distance < left.min(axis=0)) & (distance < nearest))
            nearest[hit] = distance[hit]
            on_case = center + distance[hit, None] * directions[hit] - case_low.astype(np.float32)
            side = entered[:, hit].argmax(axis=0)
            for number in range(3):
                of_side = side == number
                at = np.delete(on_case[of_side], number, axis=1) / 2.0
                # Each side has its own part of the texture, so that none is the mirror image of another.
                second = along[number, hit[of_side]] < 0
                at[:, 0] = 0.5 * at[:, 0] + 0.25 * number
                at[:, 1] = 0.4 * at[:, 1] + 0.5 * second
                colour[hit[of_side]] = _sampled(texture, at)
            for rows in open_to.values():
                rows[hit] = False
        return colour, nearest, {other: np.flatnonzero(rows) for other, rows in open_to.items() if rows.any()}

    def _through(self, room: _Room, face: NDArray[np.intp], points: Float32) -> dict[_Room, NDArray[np.bool_]]:
        """Return which rays [N] leave through the opening to each neighbour."""
        found = {}
        for number, (x, y) in enumerate(((-1, 0), (1, 0), (0, -1), (0, 1))):
            other = (room[0] + x, room[1] + y)
            middle = self._opening(room, other)
            if middle is not None:
                across = 1 - number // 2
                along = points[:, across] + room[across] * _SIZE[across]
                inside = (np.abs(along - middle) < _OPENING / 2) & (points[:, 2] < _OPENING)
                found[other] = (face == number) & inside
        return found


def _distances(low: Float64, high: Float64, center: Float32, along: Float32) -> tuple[Float32, Float32]:
    """Return where rays [3, N] from `center` enter and leave the space between the two faces of each axis, [3, N]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / along
    at_low = (low - center).astype(np.float32)[:, None] * inverse
    at_high = (high - center).astype(np.float32)[:, None] * inverse
    return np.minimum(at_low, at_high), np.maximum(at_low, at_high)


def _visited(number: int) -> _Room:
    """Return the room that the walk visits as the `number`-th: along a row, and back along the next one."""
    row, step = divmod(number, _COLUMNS)
    return (step if row % 2 == 0 else _COLUMNS - 1 - step), row


def _texture(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a texture [T, T, 3] of blotches of several sizes."""
    import cv2

    texture = np.zeros((_TEXELS, _TEXELS, 3), np.float32)
    for cells in (5, 11, 23, 47, 95, 191):
        noise = rng.random((cells, cells, 3), np.float32) - 0.5
        texture += cv2.resize(noise, (_TEXELS, _TEXELS), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + 85 * texture + rng.uniform(-25, 25, 3), 0, 255).astype(np.uint8)


def _sampled(texture: NDArray[np.uint8], at: Float32) -> NDArray[np.uint8]:
    """Return the texture at positions [N, 2] of 0 to 1, between its texels."""
    position = np.clip(at, 0.0, 0.9999) * (_TEXELS - 1)
    low = position.astype(np.intp)
    part = (position - low).astype(np.float32)[..., None]
    first, second = low[:, 0], low[:, 1]
    across, down = part[:, 0], part[:, 1]
    upper = texture[first, second] * (1 - down) + texture[first, second + 1] * down
    lower = texture[first + 1, second] * (1 - down) + texture[first + 1, second + 1] * down
    return (upper * (1 - across) + lower * across).astype(np.uint8)
