"""Cameras of other programs for a drawn folder: COLMAP models, transforms.json, Metashape and RealityCapture."""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pycolmap
from numpy.typing import NDArray

from .folders import Mixture, Shot

_TURNS = {1: ((1, 0), (0, 1)), 3: ((-1, 0), (0, -1)), 6: ((0, -1), (1, 0)), 8: ((0, 1), (-1, 0))}
"""Directions in the upright picture from directions in the stored one, by EXIF orientation."""


def draw_model(rng: np.random.Generator, mixture: Mixture, used: Sequence[str], base: Path) -> tuple[Path, set[str]]:
    """Write cameras of the photos `used`, one of each shot; return what to choose, and the photos with a camera."""
    names = dict(zip(used, _names(rng, mixture, used), strict=True))
    kind = str(rng.choice(["COLMAP", "COLMAP", "COLMAP", "transforms.json", "Metashape", "RealityCapture"]))
    mixture.kinds.add(kind)
    base.mkdir(parents=True)
    if kind == "COLMAP":
        return _colmap(rng, mixture, names, base)
    pairs = list(zip(names.values(), mixture.shots, strict=True))
    if kind == "transforms.json":
        frames = []
        for name, shot in pairs:
            matrix = np.linalg.inv(shot.viewmat) @ np.diag([1.0, -1.0, -1.0, 1.0])
            h, w = shot.pixels.shape[:2]
            lens = {"w": w, "h": h, "fl_x": shot.focal, "fl_y": shot.focal, "cx": w / 2, "cy": h / 2}
            frames.append({"file_path": name, "transform_matrix": matrix.tolist(), **lens})
        file = base / "transforms.json"
        file.write_text(json.dumps({"frames": frames}), encoding="utf-8")
    elif kind == "Metashape":
        file = base / "cameras.xml"
        file.write_text(_metashape(pairs), encoding="utf-8")
    else:
        file = base / "cameras.csv"
        file.write_text(_reality_capture(pairs), encoding="utf-8")
    return file, set(used)


def _names(rng: np.random.Generator, mixture: Mixture, used: Sequence[str]) -> list[str]:
    """Return how the model names the photos."""
    style = str(rng.choice(["same", "prefixed", "other case", "other form", "other suffix"]))
    mixture.kinds.add(f"model names: {style}")
    change = {
        "same": str,
        "prefixed": lambda name: f"scan/input/{name}",
        "other case": str.swapcase,
        "other form": lambda name: unicodedata.normalize("NFC", name),
        "other suffix": lambda name: str(Path(name).with_suffix(".JPEG")),
    }[style]
    return [change(name) for name in used]


def _stored(shot: Shot) -> tuple[NDArray[np.float64], int, int]:
    """Return world-to-camera, width and height of the picture as it is stored; of a rotated, not a mirrored one."""
    turn = np.eye(4)
    turn[:2, :2] = np.array(_TURNS[shot.orientation]).T
    h, w = shot.pixels.shape[:2]
    return turn @ shot.viewmat, *((h, w) if shot.orientation >= 5 else (w, h))


def _colmap(rng: np.random.Generator, mixture: Mixture, names: dict[str, str], base: Path) -> tuple[Path, set[str]]:
    ignores = all(shot.orientation in _TURNS for shot in mixture.shots) and rng.random() < 0.6
    if ignores and any(shot.orientation > 1 for shot in mixture.shots):
        mixture.kinds.add("model of stored pictures")
    place = str(rng.choice(["sparse", "colmap/sparse", "distorted/sparse", "dense/sparse"]))
    text, count = bool(rng.random() < 0.5), len(names)
    parts = [list(range(count))]
    if rng.random() < 0.4:
        joined = rng.random() < 0.5
        # Sub-models that share two photos are joined; of others, the largest counts.
        parts = [list(range(3)), list(range(1, count))] if joined and count > 3 else [[0], list(range(1, count))]
        mixture.kinds.add("sub-models joined" if len(parts[0]) > 1 else "sub-models apart")
    photos, model_names = list(names), list(names.values())
    placed = {photos[i] for i in (parts[-1] if len(parts[0]) == 1 else range(count))}
    for number, part in enumerate(parts):
        model = pycolmap.Reconstruction()
        for index in part:
            _add(model, rng, mixture.shots[index], model_names[index], index + 1, ignores)
        folder = base / place / str(number)
        folder.mkdir(parents=True)
        (model.write_text if text else model.write_binary)(folder)
    return base, placed


def _add(
    model: pycolmap.Reconstruction, rng: np.random.Generator, shot: Shot, name: str, number: int, ignores: bool
) -> None:
    h, w = shot.pixels.shape[:2]
    viewmat, width, height = _stored(shot) if ignores else (shot.viewmat, w, h)
    lens = pycolmap.Camera(
        model="SIMPLE_PINHOLE", width=width, height=height, params=[shot.focal, width / 2, height / 2]
    )
    lens.camera_id = number
    model.add_camera_with_trivial_rig(lens)
    # Points with the colours of the photo, at depths of a room.
    at = rng.uniform((2, 2), (w - 2, h - 2), (80, 2))
    depth = rng.uniform(2.0, 4.0, (80, 1))
    local = np.concatenate([(at - (w / 2, h / 2)) / shot.focal * depth, depth], axis=1)
    points = (local - shot.viewmat[:3, 3]) @ shot.viewmat[:3, :3]
    image = pycolmap.Image(name=name, keypoints=np.zeros((80, 2)), camera_id=number, image_id=number)
    rotation = pycolmap.Rotation3d(np.ascontiguousarray(viewmat[:3, :3]))
    model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(rotation, viewmat[:3, 3]))
    for index, (point, (x, y)) in enumerate(zip(points, at.astype(int), strict=True)):
        track = pycolmap.Track([pycolmap.TrackElement(number, index)])
        model.add_point3D(point, track, shot.pixels[y, x])


def _text(values: NDArray[np.float64]) -> str:
    return " ".join(f"{value:.16g}" for value in values.ravel())


def _metashape(pairs: Sequence[tuple[str, Shot]]) -> str:
    sensors, cameras = "", ""
    for index, (name, shot) in enumerate(pairs):
        h, w = shot.pixels.shape[:2]
        sensors += (
            f'<sensor id="{index}" type="frame"><resolution width="{w}" height="{h}"/><calibration type="frame" '
            f'class="adjusted"><f>{shot.focal}</f></calibration></sensor>'
        )
        cameras += (
            f'<camera id="{index}" sensor_id="{index}" label={quoteattr(name)}><transform>'
            f"{_text(np.linalg.inv(shot.viewmat))}</transform></camera>"
        )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="a"><sensors>{sensors}</sensors>'
        f"<cameras>{cameras}</cameras></chunk></document>"
    )


def _reality_capture(pairs: Sequence[tuple[str, Shot]]) -> str:
    lines = [f"#cameras {len(pairs)}", "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"]
    for name, shot in pairs:
        rotation = shot.viewmat[:3, :3].T @ np.diag([1.0, -1.0, -1.0])
        center = -shot.viewmat[:3, :3].T @ shot.viewmat[:3, 3]
        # Heading around -z, then pitch around x, then roll around y.
        heading = np.degrees(np.arctan2(rotation[0, 1], rotation[1, 1]))
        pitch = np.degrees(np.arcsin(np.clip(rotation[2, 1], -1.0, 1.0)))
        roll = np.degrees(np.arctan2(-rotation[2, 0], rotation[2, 2]))
        focal = shot.focal * 36.0 / max(shot.pixels.shape)
        numbers = ",".join(f"{value:.15g}" for value in (*center, heading, pitch, roll, focal))
        lines.append(f'"{name}",{numbers}' + ",0" * 8)
    return "\n".join(lines) + "\n"
