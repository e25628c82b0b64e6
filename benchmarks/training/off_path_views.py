"""Views of a random room that no photo has, with their true pictures, which Blender renders.

From some photos' places, the camera goes to half and to one and a half times the distance of what it shows in the
middle, and 20 degrees higher. Where something is in the way, it goes as far as it can; a view is left out if that is
less than half of the way.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from engine.cameras import training_pinhole
from engine.cameras.normalise import normalised_viewmat
from engine.core.arrays import Float64
from engine.objects.views import spread_cameras
from engine.scene import Camera, CameraSet, PinholeCamera
from engine.training import WELL_SEEN, TrainingView

from ..places import run_room_script
from ..rooms.drawn import drawn_from
from .off_path import KINDS, N_PLACES, TrueView

_NEAR, _FAR, _RAISED = 0.5, 1.5, 20.0
"""Distances relative to those of the photos, and degrees."""
_STEEPEST = 80.0
"""Degrees above which no view from above looks down."""
_WIDTH, _HEIGHT, _FOCAL = 480, 360, 360.0
_MIDDLE = 0.25
"""Points within this part of the picture's sides around its middle are what the photo shows there."""


def true_views(room: Path, camera_set: CameraSet, photos: Sequence[PinholeCamera]) -> list[TrueView]:
    """Return the views of a room that no photo has, with Blender's pictures, in the world of `camera_set`.

    Their valid pixels show what at least `WELL_SEEN` of the photos see, by the true surfaces.

    Parameters
    ----------
    room : Path
        With ``truth/room.json``.
    camera_set : CameraSet
        Of a project of the room, with sparse points.
    photos : sequence of PinholeCamera
        The training photos.
    """
    made = drawn_from(room)
    to_room = camera_set.original_from_world
    wanted = {
        name: {key: (to_room[:3, :3] @ place + to_room[:3, 3]).tolist() for key, place in places.items()}
        for name, places in _wanted(camera_set)
    }
    K = np.array([[_FOCAL, 0, _WIDTH / 2], [0, _FOCAL, _HEIGHT / 2], [0, 0, 1]])
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder) / "cameras.json", Path(folder) / "views"
        cameras = {"width": _WIDTH, "height": _HEIGHT, "focal": _FOCAL, "views": wanted}
        cameras["photos"] = [_in_room(photo, to_room) for photo in photos]
        file.write_text(json.dumps(cameras), encoding="utf-8")
        run_room_script("make_views.py", "--cameras", file, "--out", out, *made)
        found = json.loads((out / "cameras.json").read_text(encoding="utf-8"))
        metres = float(np.cbrt(np.linalg.det(to_room[:3, :3])))
        return [
            TrueView(
                TrainingView(
                    name, PinholeCamera(normalised_viewmat(np.array(viewmat), to_room), K, _WIDTH, _HEIGHT),
                    np.asarray(Image.open(out / f"{name}.png")), None, True,
                    np.asarray(Image.open(out / f"{name}_photos.png")) >= WELL_SEEN,
                ),
                np.load(out / f"{name}_depths.npy") / np.float32(metres),
            )
            for name, viewmat in found.items()
        ]  # fmt: skip


def _in_room(photo: PinholeCamera, to_room: Float64) -> dict[str, Any]:
    viewmat = normalised_viewmat(photo.viewmat, np.linalg.inv(to_room))
    return {"viewmat": viewmat.tolist(), "K": photo.K.tolist(), "width": photo.width, "height": photo.height}


def _wanted(camera_set: CameraSet) -> Iterator[tuple[str, dict[str, Float64]]]:
    """Yield the name of each view and, in the world, the photo's place, the wanted one, and what is looked at."""
    points = camera_set.points.astype(np.float64)
    for number, camera in enumerate(spread_cameras(camera_set.cameras, N_PLACES)):
        middle = _middle(camera, points)
        offset = camera.center - middle
        for kind, one in zip(KINDS, (offset * _NEAR, offset * _FAR, raised(offset)), strict=True):
            yield f"{kind}_{number}", {"from": camera.center, "eye": middle + one, "at": middle}


def raised(offset: Float64) -> Float64:
    """Return the place of a camera, [3], seen from what it looks at, `_RAISED` degrees higher; Z is up."""
    distance, flat = float(np.linalg.norm(offset)), float(np.linalg.norm(offset[:2]))
    height = np.radians(min(np.degrees(np.arctan2(offset[2], flat)) + _RAISED, _STEEPEST))
    return np.array([*(offset[:2] / flat * np.cos(height)), np.sin(height)]) * distance


def _middle(camera: Camera, points: Float64) -> Float64:
    """Return the place on the optical axis at the median depth of the points in the middle of a photo."""
    pinhole = training_pinhole(camera, max_side=_WIDTH)
    x, y, depth = (points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]).T
    reach = _MIDDLE * np.array([pinhole.width, pinhole.height]) / pinhole.K[0, 0]
    central = (depth > 0) & (np.abs(x) < reach[0] * depth) & (np.abs(y) < reach[1] * depth)
    middle = np.median(depth[central] if central.any() else depth[depth > 0])
    return np.asarray(camera.center + middle * camera.viewmat[2, :3])
