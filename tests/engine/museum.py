"""A few photos of the museum room, small, with their true cameras: what the command line is tried on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from PIL import Image

ROOM = Path(__file__).resolve().parents[2] / "demo" / "museum_room"
VIEWS = (6, 7, 8, 9, 10)
"""Neighbours, which see the teapot."""


def picture(view: int, size: tuple[int, int]) -> Image.Image:
    """A photo of the room, scaled to `size`."""
    with Image.open(ROOM / "photos" / f"view_{view:02}.jpg") as image:
        return image.resize(size, Image.Resampling.LANCZOS)


def write_photos(folder: Path, *, size: tuple[int, int] = (192, 144)) -> Path:
    """Write the photos as ``view_06.jpg``... and return their folder."""
    folder.mkdir(parents=True)
    for view in VIEWS:
        picture(view, size).save(folder / f"view_{view:02}.jpg", quality=95)
    return folder


def write_cameras(folder: Path, views: Mapping[str, int]) -> Path:
    """Write the true cameras of the photos (name: view) as a ``transforms.json`` with some points; return the file."""
    truth = json.loads((ROOM / "truth" / "cameras.json").read_text(encoding="utf-8"))["photos"]
    frames, points = [], []
    rng = np.random.default_rng(0)
    for name, view in views.items():
        (camera,) = [photo for photo in truth if photo["file"] == f"view_{view:02}.jpg"]
        to_world = np.linalg.inv(camera["world_to_camera"])
        lens = camera["params"]
        frames.append(
            {
                "file_path": name,
                "w": camera["width"],
                "h": camera["height"],
                "fl_x": lens["f"],
                "cx": lens["cx"],
                "cy": lens["cy"],
                "k1": lens["k1"],
                # OpenGL's axes: y up, looking along -z.
                "transform_matrix": (to_world @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist(),
            }
        )
        ahead = np.column_stack([rng.uniform(-0.8, 0.8, 80), rng.uniform(-0.6, 0.6, 80), np.ones(80)])
        points.append((ahead * rng.uniform(2.0, 4.0, (80, 1))) @ to_world[:3, :3].T + to_world[:3, 3])
    write_point_cloud(folder / "points.ply", np.concatenate(points))
    file = folder / "transforms.json"
    file.write_text(json.dumps({"ply_file_path": "points.ply", "frames": frames}), encoding="utf-8")
    return file


def write_point_cloud(path: Path, points: np.ndarray) -> None:
    """Write an ordinary coloured point cloud: no Gaussians."""
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    head += [f"property float {axis}" for axis in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    rows = np.full(len(points), 128, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)]))
    rows["xyz"] = points
    path.write_bytes("\n".join([*head, "end_header", ""]).encode("ascii") + rows.tobytes())
