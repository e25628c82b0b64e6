# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera poses of the photos. World: Z up, metres; camera axes: x right, y down, z forward."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np

from .shapes import Point2


@dataclass(frozen=True)
class View:
    """A hand-held photo: its name, 4x4 world-to-camera matrix and exposure in stops."""

    name: str
    world_to_camera: np.ndarray
    exposure: float


@dataclass(frozen=True)
class Walk:
    """An arc around the exhibits.

    Attributes
    ----------
    share
        Number of photos relative to the other arcs.
    radius, eye, aim
        Radius of the arc, and heights of the camera and of the point it looks at, in metres.
    spread
        The arc extends from -spread to +spread degrees about the front.
    follow
        Fraction by which the aim moves sideways with the camera: 0 looks at the centre, 1 straight ahead.
    """

    share: int
    radius: float
    spread: float
    eye: float
    aim: float
    follow: float


def plan(walks: Sequence[Walk], centre: Point2, count: int, seed: int) -> list[View]:
    """Return `count` views on arcs around a point on the floor, with random offsets as of a hand-held camera."""
    rng = np.random.default_rng(seed)
    total = sum(walk.share for walk in walks)
    views: list[View] = []
    cumulative_share = 0
    for index, walk in enumerate(walks):
        cumulative_share += walk.share
        number = round(count * cumulative_share / total) - len(views)
        # Every second arc is walked in the opposite direction.
        angles = np.linspace(-walk.spread, walk.spread, number) if number > 1 else np.zeros(number)
        for angle in angles[:: -1 if index % 2 else 1]:
            views.append(_view(len(views), walk, np.array(centre), radians(angle + rng.normal(0, 1.2)), rng))
    return views


def _view(index: int, walk: Walk, centre: np.ndarray, angle: float, rng: np.random.Generator) -> View:
    ground = centre + walk.radius * np.array([sin(angle), -cos(angle)])
    eye = np.array([*ground, walk.eye]) + rng.normal(0, 0.035, 3)
    aim = np.array([centre[0] + walk.follow * eye[0], centre[1] + 0.1, walk.aim]) + rng.normal(0, 0.05, 3)
    return View(
        f"view_{index:02d}",
        look_at(eye, aim, radians(rng.normal(0, 2.2))),
        float(np.clip(rng.normal(0, 0.12), -0.25, 0.25)),
    )


def look_at(eye: np.ndarray, aim: np.ndarray, roll: float) -> np.ndarray:
    """Return a world-to-camera matrix."""
    forward = (aim - eye) / np.linalg.norm(aim - eye)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    tilt = np.array([[cos(roll), sin(roll), 0], [-sin(roll), cos(roll), 0], [0, 0, 1]])
    matrix = np.eye(4)
    matrix[:3, :3] = tilt @ np.stack([right, down, forward])
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return matrix


def useful_order(count: int) -> list[int]:
    """Return photo indices in an order of which every prefix covers the scene evenly."""
    return [i for stride in range(4) for i in range((0, 2, 1, 3)[stride], count, 4)]
