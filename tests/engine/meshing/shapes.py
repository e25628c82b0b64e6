"""Objects of known shape as Gaussians on a table, with photos from around them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from engine.formats import SH_C0
from engine.objects import DetailPhotos
from engine.pictures import Scene, write_png
from engine.scene import Camera, Gaussians, PinholeCamera

SIDE, FOCAL = 240, 260.0


@dataclass(frozen=True)
class Shown:
    """A scene with an object, its photos and their cameras."""

    gaussians: Gaussians
    members: np.ndarray
    cameras: list[Camera]
    photos: DetailPhotos


def ball(radius: float, count: int, *, center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return points and normals on a ball, [count, 6]."""
    numbers = np.arange(count) + 0.5
    height, angle = 1 - 2 * numbers / count, np.pi * (1 + 5**0.5) * numbers
    across = np.sqrt(1 - height**2)
    normals = np.column_stack([across * np.cos(angle), across * np.sin(angle), height])
    return np.hstack([radius * normals + center, normals])


def sheet(width: float, height: float, step: float, *, y: float = 0.0, normal: float = -1.0) -> np.ndarray:
    """Return points and normals on an upright rectangle."""
    x, z = (np.arange(-size / 2, size / 2 + step / 2, step) for size in (width, height))
    grid = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
    normals = np.tile([0.0, normal, 0.0], (len(grid), 1))
    return np.hstack([np.column_stack([grid[:, 0], np.full(len(grid), y), grid[:, 1]]), normals])


def disk(radius: float, step: float, z: float) -> np.ndarray:
    """Return points and normals on a horizontal disk."""
    x = np.arange(-radius, radius + step / 2, step)
    grid = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    grid = grid[np.linalg.norm(grid, axis=1) <= radius]
    return np.hstack([grid, np.full((len(grid), 1), z), np.tile([0.0, 0, 1], (len(grid), 1))])


def gaussians_on(points: np.ndarray, size: float, *, opacity: float = 0.98) -> Gaussians:
    """Return flat Gaussians on points with normals, red, green and blue by their places."""
    normals = points[:, 3:]
    # The quaternion that turns the z axis to the normal.
    quats = np.column_stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(len(points))])
    quats[normals[:, 2] < -1 + 1e-6] = (0, 1, 0, 0)
    colors = 0.5 + 0.4 * np.sin(6 * points[:, :3])
    logits = np.full(len(points), np.log(opacity / (1 - opacity)))
    scales = np.tile(np.log([size, size, 0.1 * size]), (len(points), 1))
    values = (points[:, :3], scales, quats, logits, (colors[:, None] - 0.5) / SH_C0)
    return Gaussians(*(np.asarray(one, np.float32) for one in values))


def around(
    elevations: tuple[float, ...], count: int, *, distance: float = 3.0, span: float = 2 * np.pi
) -> list[Camera]:
    """Return cameras that look at the origin from rings around it, or from a part of them."""
    cameras = []
    for elevation in elevations:
        for number in range(count):
            angle = -np.pi / 2 + span * ((number + 0.5) / count - 0.5)
            back = np.array([np.cos(elevation) * np.cos(angle), np.cos(elevation) * np.sin(angle), np.sin(elevation)])
            right = np.array([-np.sin(angle), np.cos(angle), 0])
            rotation = np.stack([right, np.cross(-back, right), -back])
            viewmat = np.eye(4)
            viewmat[:3, :3], viewmat[:3, 3] = rotation, -rotation @ (distance * back)
            name = f"photo_{len(cameras):02d}.png"
            cameras.append(Camera(name, SIDE, SIDE, "PINHOLE", (FOCAL, FOCAL, SIDE / 2, SIDE / 2), viewmat))
    return cameras


def pinhole(camera: Camera) -> PinholeCamera:
    """Return a camera as the rasterizer needs it."""
    K = np.array([[FOCAL, 0, SIDE / 2], [0, FOCAL, SIDE / 2], [0, 0, 1]])
    return PinholeCamera(camera.viewmat, K, SIDE, SIDE)


def shown(folder: Path, own: Gaussians, others: Gaussians | None, cameras: list[Camera]) -> Shown:
    """Return a scene whose photos are rendered into `folder`."""
    parts = [own] if others is None else [own, others]
    joined = Gaussians(*(
        np.concatenate([getattr(one, name) for one in parts])
        for name in ("means", "log_scales", "quats", "opacity_logits", "sh")
    ))  # fmt: skip
    scene = Scene(joined)
    for camera in cameras:
        picture = scene.render(pinhole(camera), color=True).channels
        write_png(folder / camera.photo, (255 * np.clip(picture, 0, 1)).astype(np.uint8))
    return Shown(joined, np.arange(len(joined)) < len(own), cameras, DetailPhotos(folder))
