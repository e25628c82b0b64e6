# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the photographer stands for every photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np

from .meshes import Point2


@dataclass(frozen=True)
class View:
    """One hand-held photo: where from, 4x4 world-to-camera (OpenCV axes), and exposure in stops."""

    name: str
    world_to_camera: np.ndarray
    exposure: float


@dataclass(frozen=True)
class Walk:
    """One arc around the exhibits.

    Attributes
    ----------
    share
        How many photos, beside those of the other walks.
    spread
        The arc runs from -spread to +spread degrees about the front.
    follow
        How far the aim slides sideways with the walker: 0 looks at the middle, 1 straight ahead.
    """

    share: int
    radius: float
    spread: float
    eye: float
    aim: float
    follow: float


def plan(walks: Sequence[Walk], centre: Point2, count: int, seed: int) -> list[View]:
    """Spread `count` photos over walks around a place on the floor, with the unsteadiness of a hand."""
    rng = np.random.default_rng(seed)
    total = sum(walk.share for walk in walks)
    views: list[View] = []
    done = 0
    for way, walk in enumerate(walks):
        done += walk.share
        number = round(count * done / total) - len(views)
        # Every second walk goes back the other way, as one does.
        angles = np.linspace(-walk.spread, walk.spread, number) if number > 1 else np.zeros(number)
        for angle in angles[:: -1 if way % 2 else 1]:
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
    """World-to-camera matrix, camera axes x right, y down, z forward."""
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
    """Order the photos so that any beginning of the list already covers the room evenly."""
    return [i for stride in range(4) for i in range((0, 2, 1, 3)[stride], count, 4)]
