# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a room from cameras that took no photo."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from studio import materials, shoot
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
TOLERANCE = 0.02
"""Part of its depth by which a place may be behind what a photo shows at its pixel and still be seen."""


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
        help="folder for NAME.png, NAME_photos.png, whose pixels tell how many of the photos see what is there, "
        "NAME_depths.npy, float32 in metres along the view axis, 0 for nothing, and cameras.json with viewmats",
    )  # fmt: skip
    arguments = parser.parse_args()
    cameras = json.loads(arguments.cameras.read_text(encoding="utf-8"))
    arguments.out.mkdir(parents=True, exist_ok=True)
    build(draw_room(arguments.seed, arguments.attempt))
    shoot.setup_photos(SAMPLES, bounces=1)
    _set_lens(cameras["focal"], cameras["width"], cameras["height"])
    made = {}
    for number, (name, wanted) in enumerate(cameras["views"].items()):
        eye = _free_eye(*(np.array(wanted[key]) for key in ("from", "eye")))
        if eye is None:
            continue
        viewmat = _looking_at(eye, np.array(wanted["at"]))
        shoot.aim_camera(View(name, viewmat, 0.0))
        bpy.context.scene.cycles.seed = number
        Image.fromarray(srgb_pixels(np.clip(shoot.render(), 0, 1))).save(arguments.out / f"{name}.png")
        made[name] = viewmat.tolist()
    for name, count, depths in _photos_that_see(made, cameras):
        Image.fromarray(count).save(arguments.out / f"{name}_photos.png")
        np.save(arguments.out / f"{name}_depths.npy", depths.astype(np.float32))
    shoot.write_json(arguments.out / "cameras.json", made)
    return 0


def _set_lens(focal: float, width: int, height: int) -> None:
    """Set the size of the pictures and the focal length, in pixels."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = width, height
    lens = scene.camera.data
    lens.lens = lens.sensor_width * focal / width


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


def _photos_that_see(
    viewmats: Mapping[str, Sequence[Sequence[float]]], cameras: Mapping[str, Any]
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield the name of each view, how many photos see what its pixels show, uint8, and depths, all [height, width]."""
    focal, width, height = cameras["focal"], cameras["width"], cameras["height"]
    rays = np.stack([*np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)], axis=-1)
    rays = np.concatenate([rays / focal, np.ones((height, width, 1))], axis=-1)
    with shoot.mask_rendering(materials.depth()):
        photos = [(photo, *_centred_depths(photo)) for photo in cameras["photos"]]
        _set_lens(focal, width, height)
        for name, rows in viewmats.items():
            viewmat, counts = np.array(rows), np.zeros((height, width), np.uint8)
            shown = _depths(viewmat)
            local = rays * shown[..., None]
            places = (local - viewmat[:3, 3]) @ viewmat[:3, :3]
            for photo, depths, corner in photos:
                counts += _sees(photo, depths, corner, places)
            yield name, counts, shown


def _centred_depths(photo: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return what a photo shows, as depths, in a picture whose middle is on the optical axis, and where that begins."""
    K, size = np.array(photo["K"]), np.array([photo["width"], photo["height"]])
    middle = K[:2, 2]
    reach = np.ceil(np.maximum(middle, size - middle)).astype(int)
    _set_lens(K[0, 0], *(2 * reach).tolist())
    return _depths(np.array(photo["viewmat"])), middle - reach


def _depths(viewmat: np.ndarray) -> np.ndarray:
    """Return the depths [height, width] of what a camera sees, 0 for nothing, within `mask_rendering`."""
    shoot.aim_camera(View("", viewmat, 0.0))
    return shoot.render()[..., 0]


def _sees(photo: Mapping[str, Any], depths: np.ndarray, corner: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return which of `places`, [height, width, 3], a photo sees."""
    viewmat = np.array(photo["viewmat"])
    local = places @ viewmat[:3, :3].T + viewmat[:3, 3]
    depth = np.maximum(local[..., 2], 1e-6)
    pixels = (local @ np.array(photo["K"]).T)[..., :2] / depth[..., None]
    inside = ((pixels >= 0) & (pixels < (photo["width"], photo["height"]))).all(axis=-1) & (local[..., 2] > 0)
    column, row = np.moveaxis(np.where(inside[..., None], pixels - corner, 0).astype(int), -1, 0)
    return inside & (depth <= depths[row, column] * (1 + TOLERANCE))


def _looking_at(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the world-to-camera matrix [4, 4] of an upright camera; x right, y down, z forward."""
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat
