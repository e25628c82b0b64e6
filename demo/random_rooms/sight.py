# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera walks, and an estimate of what the photos show, without rendering."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from studio.phone import Phone
from studio.shapes import rotation
from studio.views import View, Walk

from .boxes import Box, hidden, placed_box
from .layout import Dimensions, Placed
from .stuffs import Rng, uniform

_POINTS = 110
_CELL = 8


def draw_walks(rng: Rng, room: Dimensions) -> tuple[Walk, ...]:
    """Draw two to four arcs of different heights, of which the first is wide and at the height of eyes."""
    farthest = min(room.reach + 1.2, room.half_width - 0.32, room.back - 0.32 if room.island else 9.0)
    nearest = room.reach + 0.5
    walks = []
    for k in range(int(rng.integers(2, 5))):
        first = k == 0
        spread = uniform(rng, 125, 165) if room.island else uniform(rng, 70 if first else 48, 84)
        walks.append(
            Walk(
                share=int(rng.integers(4, 7)) if first else int(rng.integers(2, 5)),
                radius=farthest - uniform(rng, 0, 0.1) if first else uniform(rng, nearest, farthest),
                spread=spread,
                eye=uniform(rng, 1.45, 1.7) if first else uniform(rng, 1.1, 2.15),
                aim=uniform(rng, 0.95, 1.15) if first else uniform(rng, 0.8, 1.25),
                follow=0.0 if room.island or first else uniform(rng, 0, 0.4),
            )
        )
    return tuple(walks)


def eye_of(view: View) -> np.ndarray:
    """Return the position of a camera [3]."""
    return -view.world_to_camera[:3, :3].T @ view.world_to_camera[:3, 3]


def is_walkable(eyes: np.ndarray, room: Dimensions) -> bool:
    """Return whether cameras at these positions [V, 3] are in the room, away from its walls."""
    lowest = room.front + 0.18 if room.island else room.front
    inside = np.abs(eyes[:, 0]) <= room.half_width - 0.18
    inside &= (eyes[:, 1] <= room.back - 0.18) & (eyes[:, 1] >= lowest)
    return bool(inside.all())


def estimated_pixels(views: Sequence[View], placed: Sequence[Placed], phone: Phone) -> dict[int, np.ndarray]:
    """Return how many pixels each photo shows of each exhibit, estimated with points on its surface and boxes.

    The estimate is coarse: `generate` counts the pixels of rendered masks.
    """
    points, owners, boxes, of = [], [], [], []
    for number, one in enumerate(placed):
        if one.exhibit is not None:
            sampled = surface_points(one, _POINTS)
            points.append(sampled)
            owners.append(np.full(len(sampled), number))
        for box in _solid(one):
            boxes.append(box)
            of.append(number)
    all_points, all_owners = np.concatenate(points), np.concatenate(owners)
    counts = {one.exhibit: np.zeros(len(views)) for one in placed if one.exhibit is not None}
    for index, view in enumerate(views):
        local = all_points @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]
        depth = np.maximum(local[:, 2], 0.05)
        pixel = local[:, :2] / depth[:, None] * phone.focal + phone.centre
        seen = (local[:, 2] > 0.1) & ((pixel >= 0) & (pixel < [phone.width, phone.height])).all(axis=1)
        candidates = np.flatnonzero(seen)
        blocked = hidden(eye_of(view), all_points[candidates], all_owners[candidates], boxes, np.array(of))
        candidates = candidates[~blocked]
        columns, rows = (pixel[candidates] // _CELL).astype(int).T
        cells = np.unique((all_owners[candidates] * phone.height + rows) * phone.width + columns)
        seen_of = np.bincount(cells // (phone.width * phone.height), minlength=len(placed)) * _CELL**2
        for number, one in enumerate(placed):
            if one.exhibit is not None:
                counts[one.exhibit][index] = seen_of[number]
    return counts


def surface_points(one: Placed, count: int) -> np.ndarray:
    """Return points [count, 3] on the surface of a thing in the room, in proportion to area."""
    quads, areas = [], []
    for part in one.thing.parts:
        corners = part.shape.vertices[part.shape.quads]
        quads.append(corners)
        areas.append(np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1))
    total = np.cumsum(np.concatenate(areas))
    chosen = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1])
    corners = np.concatenate(quads)[np.minimum(chosen, len(total) - 1)]
    # Places within the quads that are spread evenly.
    u, v = ((np.arange(count)[:, None] * [0.7548777, 0.5698403]) % 1.0).T[:, :, None]
    local = (1 - v) * ((1 - u) * corners[:, 0] + u * corners[:, 1]) + v * ((1 - u) * corners[:, 3] + u * corners[:, 2])
    return local @ rotation("z", one.turn).T + np.array(one.where)


def _solid(one: Placed) -> list[Box]:
    """Return boxes that hide what is behind: the large parts of furniture, most of the box of an exhibit."""
    if one.exhibit is not None:
        box = one.box.grown(-0.16 * min(one.box.half_x, one.box.half_y))
        cavity = one.thing.cavity
        return [box if cavity is None else replace(box, top=one.where[2] + cavity.rim)]
    boxes = []
    for part in one.thing.parts:
        low, high = part.shape.vertices.min(axis=0), part.shape.vertices.max(axis=0)
        if not getattr(part.stuff, "hidden", False) and np.sort(high - low)[1] > 0.1:
            boxes.append(placed_box(low, high, one.where, one.turn))
    return boxes
