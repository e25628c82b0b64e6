# SPDX-License-Identifier: GPL-3.0-or-later
"""The true meshes of the exhibits of a room."""

from __future__ import annotations

import argparse
from pathlib import Path

import bpy
import numpy as np
from studio.stage import SEEN_THROUGH

from .generate import build
from .plan import draw_room


def main(description: str | None) -> int:
    """Parse the command line, write the meshes, and return the exit code."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, required=True, help="of the room")
    parser.add_argument("--attempt", type=int, required=True, help="of the room, as its truth/room.json says")
    parser.add_argument(
        "--out", type=Path, required=True,
        help=".npz: for each exhibit NAME, NAME/vertices [V, 3] and NAME/faces [F, 3]; parts of glass that are seen "
        "through are left out",
    )  # fmt: skip
    arguments = parser.parse_args()
    plan = draw_room(arguments.seed, arguments.attempt)
    build(plan)
    arrays: dict[str, np.ndarray] = {}
    for identity, one in enumerate(plan.exhibits, start=1):
        parts = [part for part in bpy.context.scene.objects if part.type == "MESH" and part.pass_index == identity]
        made = [_triangles(part) for part in parts if SEEN_THROUGH not in part]
        if not made:
            continue
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in made[:-1])])
        arrays[f"{one.name}/vertices"] = np.concatenate([vertices for vertices, _ in made])
        arrays[f"{one.name}/faces"] = np.concatenate([faces + k for (_, faces), k in zip(made, starts, strict=True)])
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(arguments.out, **arrays)
    return 0


def _triangles(part: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices in the room and triangles of an object, with its modifiers."""
    evaluated = part.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    vertices, faces = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loop_triangles.foreach_get("vertices", faces)
    matrix = np.array(evaluated.matrix_world)
    places = vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    evaluated.to_mesh_clear()
    return places.astype(np.float32), faces.reshape(-1, 3)
