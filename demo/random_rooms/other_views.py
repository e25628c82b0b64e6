# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a room from cameras that took no photo."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

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


def main(description: str | None) -> int:
    """Parse the command line, render the views, and return the exit code."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, required=True, help="of the room")
    parser.add_argument("--attempt", type=int, required=True, help="of the room, as its truth/room.json says")
    parser.add_argument(
        "--cameras", type=Path, required=True,
        help="JSON: width, height and focal, in pixels, and views by name, each with `from`, a free place in the room, "
        "the wanted `eye`, which is moved towards it where something is in the way, and what it looks `at`, in metres",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, help="folder for NAME.png, and cameras.json with viewmats")
    arguments = parser.parse_args()
    cameras = json.loads(arguments.cameras.read_text(encoding="utf-8"))
    arguments.out.mkdir(parents=True, exist_ok=True)
    build(draw_room(arguments.seed, arguments.attempt))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = cameras["width"], cameras["height"]
    lens = scene.camera.data
    lens.lens = lens.sensor_width * cameras["focal"] / cameras["width"]
    shoot.setup_photos(SAMPLES, bounces=1)
    made = {}
    for number, (name, wanted) in enumerate(cameras["views"].items()):
        eye = _free_eye(*(np.array(wanted[key]) for key in ("from", "eye")))
        if eye is None:
            continue
        viewmat = _looking_at(eye, np.array(wanted["at"]))
        shoot.aim_camera(View(name, viewmat, 0.0))
        scene.cycles.seed = number
        Image.fromarray(srgb_pixels(np.clip(shoot.render(), 0, 1))).save(arguments.out / f"{name}.png")
        made[name] = viewmat.tolist()
    shoot.write_json(arguments.out / "cameras.json", made)
    return 0


def _free_eye(begin: np.ndarray, end: np.ndarray) -> np.ndarray | None:
    """Return the last free place on the way from `begin` to `end`; None if the way is mostly blocked."""
    length = float(np.linalg.norm(end - begin))
    direction = (end - begin) / length
    scene = bpy.context.scene
    hit, where, *_ = scene.ray_cast(
        bpy.context.evaluated_depsgraph_get(), Vector(begin), Vector(direction), distance=length + KEPT_DISTANCE
    )
    free = float(np.linalg.norm(np.array(where) - begin)) - KEPT_DISTANCE if hit else length
    return begin + min(free, length) * direction if free >= LEAST_SHARE * length else None


def _looking_at(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the world-to-camera matrix [4, 4] of an upright camera; x right, y down, z forward."""
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat
