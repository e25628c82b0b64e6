# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a room from cameras that took no photo."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from studio import shoot
from studio.phone import srgb_pixels
from studio.views import View

# `studio.shoot` gives bpy its settings, so it is imported before.
import bpy  # isort: skip
from mathutils import Vector  # isort: skip

from .generate import build
from .plan import draw_room

SAMPLES = 6
KEPT_DISTANCE = 0.35
"""Distance in metres of a camera from what it would run into."""
LEAST_SHARE = 0.5
"""A view is left out if less of its way is free."""
STRIDE = 4
"""Pixels between two of which photos are counted; those between have the count of the nearest."""
MARGIN = 0.02
"""Distance in metres by which a ray may end before a place and still reach it."""


class Photo(NamedTuple):
    """A pinhole camera in the room: world-to-camera matrix [4, 4], intrinsics [3, 3], and the size of its picture."""

    viewmat: np.ndarray
    K: np.ndarray
    width: int
    height: int

    @property
    def eye(self) -> np.ndarray:
        """Position of the camera [3]."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Return x and y, in pixels, and depth of `places` [..., 3]."""
        x, y, depth = np.moveaxis((places @ self.viewmat[:3, :3].T + self.viewmat[:3, 3]) @ self.K.T, -1, 0)
        return np.stack([x / depth, y / depth, depth], axis=-1)


def main(description: str | None) -> int:
    """Parse the command line, render the views, and return the exit code."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, required=True, help="of the room")
    parser.add_argument("--attempt", type=int, required=True, help="of the room, as its truth/room.json says")
    parser.add_argument(
        "--cameras", type=Path, required=True,
        help="JSON: width, height and focal, in pixels, and views by name, each with `from`, a free place in the room, "
        "the wanted `eye`, which is moved towards it where something is in the way, and what it looks `at`, in metres; "
        "photos, each with `viewmat`, `K`, `width` and `height`",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, required=True,
        help="folder for NAME.png, NAME_photos.png, whose pixels tell how many of the photos see what is there, and "
        "cameras.json with viewmats",
    )  # fmt: skip
    arguments = parser.parse_args()
    cameras = json.loads(arguments.cameras.read_text(encoding="utf-8"))
    arguments.out.mkdir(parents=True, exist_ok=True)
    build(draw_room(arguments.seed, arguments.attempt))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = cameras["width"], cameras["height"]
    lens = scene.camera.data
    lens.lens = lens.sensor_width * cameras["focal"] / cameras["width"]
    shoot.setup_photos(SAMPLES, bounces=1)
    photos = [
        Photo(np.array(one["viewmat"]), np.array(one["K"]), one["width"], one["height"]) for one in cameras["photos"]
    ]
    K = np.array([[cameras["focal"], 0, cameras["width"] / 2], [0, cameras["focal"], cameras["height"] / 2], [0, 0, 1]])
    made = {}
    for number, (name, wanted) in enumerate(cameras["views"].items()):
        eye = _free_eye(*(np.array(wanted[key]) for key in ("from", "eye")))
        if eye is None:
            continue
        viewmat = _looking_at(eye, np.array(wanted["at"]))
        shoot.aim_camera(View(name, viewmat, 0.0))
        scene.cycles.seed = number
        Image.fromarray(srgb_pixels(np.clip(shoot.render(), 0, 1))).save(arguments.out / f"{name}.png")
        counts = _photos_that_see(_places(Photo(viewmat, K, cameras["width"], cameras["height"])), photos)
        Image.fromarray(counts.astype(np.uint8)).save(arguments.out / f"{name}_photos.png")
        made[name] = viewmat.tolist()
    shoot.write_json(arguments.out / "cameras.json", made)
    return 0


def _free_eye(begin: np.ndarray, end: np.ndarray) -> np.ndarray | None:
    """Return the last free place on the way from `begin` to `end`; None if the way is mostly blocked."""
    length = float(np.linalg.norm(end - begin))
    direction = (end - begin) / length
    free = min(_free_distance(begin, direction, length + KEPT_DISTANCE) - KEPT_DISTANCE, length)
    return begin + free * direction if free >= LEAST_SHARE * length else None


def _free_distance(begin: np.ndarray, direction: np.ndarray, longest: float = 1e3) -> float:
    """Return the distance from `begin` to what is in the way, at most `longest`, in metres."""
    hit, where, *_ = bpy.context.scene.ray_cast(
        bpy.context.evaluated_depsgraph_get(), Vector(begin), Vector(direction), distance=longest
    )
    return float(np.linalg.norm(np.array(where) - begin)) if hit else longest


def _places(view: Photo) -> np.ndarray:
    """Return the places [height, width, 3] that the pixels of a view show."""
    rows, columns = (np.arange(STRIDE // 2, size, STRIDE) for size in (view.height, view.width))
    pixels = np.stack([*np.meshgrid(columns + 0.5, rows + 0.5), np.ones((len(rows), len(columns)))], axis=-1)
    rays = pixels @ np.linalg.inv(view.K).T @ view.viewmat[:3, :3]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    distances = np.array([[_free_distance(view.eye, ray) for ray in row] for row in rays])
    places = view.eye + distances[..., None] * rays
    return places.repeat(STRIDE, axis=0).repeat(STRIDE, axis=1)[: view.height, : view.width]


def _photos_that_see(places: np.ndarray, photos: Sequence[Photo]) -> np.ndarray:
    """Return how many photos see each of `places`, [height, width, 3], shape [height, width]."""
    distinct = places[::STRIDE, ::STRIDE]
    counts = np.zeros(distinct.shape[:2], int)
    for photo in photos:
        x, y, depth = np.moveaxis(photo.pixels(distinct), -1, 0)
        inside = (depth > 0) & (x > 0) & (x < photo.width) & (y > 0) & (y < photo.height)
        for row, column in np.argwhere(inside):
            ray = distinct[row, column] - photo.eye
            distance = float(np.linalg.norm(ray))
            counts[row, column] += _free_distance(photo.eye, ray / distance) > distance - MARGIN
    return counts.repeat(STRIDE, axis=0).repeat(STRIDE, axis=1)[: places.shape[0], : places.shape[1]]


def _looking_at(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the world-to-camera matrix [4, 4] of an upright camera; x right, y down, z forward."""
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat
