"""Pictures of a textured box room with cases in it, from pinhole, fisheye and panoramic cameras, without Blender."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from engine.core.arrays import Float64

Projection = Literal["pinhole", "fisheye", "panorama"]

_SIZE = (7.0, 5.0, 3.0)
_TEXELS = 768


def looking_along(center: Float64, direction: Float64) -> Float64:
    """Return world-to-camera [4, 4] of a level camera (Z up) at `center` that looks along `direction`."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(z, (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([x, np.cross(z, x), z])
    viewmat[:3, 3] = -viewmat[:3, :3] @ center
    return viewmat


def rays(width: int, height: int, projection: Projection, focal: float) -> Float64:
    """Return the directions [H, W, 3] of the pixels in camera axes; `focal` in pixels, unused for a panorama."""
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    if projection == "pinhole":
        return np.stack([x / focal, y / focal, np.ones_like(x)], axis=-1)
    if projection == "fisheye":
        # Equidistant: the distance from the centre is the focal length times the angle.
        radius = np.hypot(x, y) + 1e-9
        angle = radius / focal
        return np.stack([x / radius * np.sin(angle), y / radius * np.sin(angle), np.cos(angle)], axis=-1)
    longitude, latitude = x / width * 2 * np.pi, y / width * 2 * np.pi
    return np.stack(
        [np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)], axis=-1
    )


@dataclass
class BoxRoom:
    """A room of 7 x 5 x 3 units whose centre is at the origin of x and y, with the floor at z = 0.

    Parameters
    ----------
    seed : int
        Draws textures and cases.
    same_walls : bool
        Give both long walls the same texture.
    """

    seed: int
    same_walls: bool = False

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self._walls = [_texture(rng) for _ in range(6)]
        if self.same_walls:
            # Faces are seen from inside: the opposite wall shows the same picture only when it is mirrored.
            self._walls[3] = np.ascontiguousarray(self._walls[2][::-1])
        self._cases = []
        for _ in range(6):
            side = rng.choice([-1.0, 1.0])
            x, y = rng.uniform(-2.6, 2.6), side * rng.uniform(1.7, 2.1)
            half = rng.uniform(0.15, 0.35, 3) * (1.0, 1.0, 2.0)
            self._cases.append((np.array([x, y, half[2]]) - half, np.array([x, y, half[2]]) + half, _texture(rng)))

    def picture(self, center: Float64, directions: Float64) -> Image.Image:
        """Return what is seen from `center` along `directions` [H, W, 3] in world axes."""
        height, width, _ = directions.shape
        flat = directions.reshape(-1, 3)
        low, high = np.array([-_SIZE[0] / 2, -_SIZE[1] / 2, 0.0]), np.array([_SIZE[0] / 2, _SIZE[1] / 2, _SIZE[2]])
        with np.errstate(divide="ignore", invalid="ignore"):
            colour, _ = _inner_faces(center, flat, low, high, self._walls)
            nearest = np.full(len(flat), np.inf)
            for case_low, case_high, texture in self._cases:
                at_low, at_high = (case_low - center) / flat, (case_high - center) / flat
                enter, leave = np.minimum(at_low, at_high), np.maximum(at_low, at_high)
                axis = enter.argmax(axis=1)
                distance = enter.max(axis=1)
                hit = (distance > 0.05) & (distance < leave.min(axis=1)) & (distance < nearest)
                points = center + distance[hit, None] * flat[hit]
                nearest[hit] = distance[hit]
                colour[hit] = _sampled(texture, _without_axis(points - case_low, axis[hit]) / 2.0)
        return Image.fromarray(colour.reshape(height, width, 3).astype(np.uint8))


def _texture(rng: np.random.Generator) -> Float64:
    """Return a texture [T, T, 3] of blotches of several sizes, 0 to 255."""
    texture = np.zeros((_TEXELS, _TEXELS, 3))
    for cells in (6, 12, 24, 48, 96, 192):
        noise = Image.fromarray((rng.random((cells, cells, 3)) * 255).astype(np.uint8))
        texture += np.asarray(noise.resize((_TEXELS, _TEXELS), Image.Resampling.BICUBIC), float) - 127.5
    return np.clip(128 + texture * 0.45 + rng.uniform(-25, 25, 3), 0, 255)


def _inner_faces(
    center: Float64, flat: Float64, low: Float64, high: Float64, textures: list[Float64]
) -> tuple[Float64, Float64]:
    """Return the colours [N, 3] and distances [N] of the inner faces of a box that contains `center`."""
    distance = np.where(flat > 0, (high - center) / flat, (low - center) / flat)
    axis = distance.argmin(axis=1)
    nearest = distance[np.arange(len(flat)), axis]
    points = center + nearest[:, None] * flat
    face = 2 * axis + (flat[np.arange(len(flat)), axis] > 0)
    colour = np.zeros((len(flat), 3))
    for index, texture in enumerate(textures):
        chosen = face == index
        colour[chosen] = _sampled(texture, _without_axis(points[chosen] - low, axis[chosen]) / 7.0)
    return colour, nearest


def _without_axis(points: Float64, axis: NDArray[np.intp]) -> Float64:
    """Return the two coordinates [N, 2] of each point [N, 3] beside its `axis`."""
    first = np.where(axis == 0, 1, 0)
    second = np.where(axis == 2, 1, 2)
    rows = np.arange(len(points))
    return np.stack([points[rows, first], points[rows, second]], axis=1)


def _sampled(texture: Float64, at: Float64) -> Float64:
    """Return the texture at positions [N, 2] of 0 to 1, between its texels."""
    position = np.clip(at, 0.0, 0.9999) * (_TEXELS - 1)
    low = position.astype(int)
    part = position - low
    value = np.zeros((len(at), 3))
    for i in (0, 1):
        for j in (0, 1):
            weight = np.abs(1 - i - part[:, 0]) * np.abs(1 - j - part[:, 1])
            value += weight[:, None] * texture[low[:, 0] + i, low[:, 1] + j]
    return value
