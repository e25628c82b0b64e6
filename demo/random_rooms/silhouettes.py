# SPDX-License-Identifier: GPL-3.0-or-later
"""The true silhouettes of the exhibits of a room, each alone."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from studio import shoot
from studio.phone import save_ids
from studio.views import View

# `studio.shoot` gives bpy its settings, so it is imported before.
import bpy  # isort: skip

from .generate import build
from .plan import draw_room


def main(description: str | None) -> int:
    """Parse the command line, render the silhouettes, and return the exit code."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, required=True, help="of the room")
    parser.add_argument("--attempt", type=int, required=True, help="of the room, as its truth/room.json says")
    parser.add_argument(
        "--cameras", type=Path, required=True,
        help="JSON: side, in pixels, and views by name of the exhibit, each with viewmat (4x4, world-to-camera) and "
        "focal, in pixels",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, help="folder for NAME_NUMBER.png, 255 in the silhouette")
    arguments = parser.parse_args()
    cameras = json.loads(arguments.cameras.read_text(encoding="utf-8"))
    arguments.out.mkdir(parents=True, exist_ok=True)
    plan = draw_room(arguments.seed, arguments.attempt)
    build(plan)
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = cameras["side"]
    identities = {one.name: number for number, one in enumerate(plan.exhibits, start=1)}
    for name, number, mask in _silhouettes(cameras["views"], identities):
        save_ids(mask, arguments.out / f"{name}_{number}.png")
    return 0


def _silhouettes(
    views: Mapping[str, Sequence[Mapping[str, Any]]], identities: Mapping[str, int]
) -> Iterator[tuple[str, int, np.ndarray]]:
    """Yield the name, the number of the view and the silhouette of each exhibit in each of its views."""
    scene = bpy.context.scene
    lens = scene.camera.data
    with shoot.mask_rendering():
        # What is seen through stays hidden.
        things = [one for one in scene.objects if one.type == "MESH" and not one.hide_render]
        for name, frames in views.items():
            for thing in things:
                thing.hide_render = thing.pass_index != identities[name]
            for number, frame in enumerate(frames):
                lens.lens = lens.sensor_width * frame["focal"] / scene.render.resolution_x
                shoot.aim_camera(View(name, np.array(frame["viewmat"]), 0.0))
                ids = np.rint(shoot.render()[..., 0] * 255).astype(np.uint8)
                yield name, number, np.where(ids == identities[name], 255, 0).astype(np.uint8)
