"""What the photos show of an object: for each pixel, how deep its surface is, or how far the ray is free of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cameras import training_pinhole
from ..core.arrays import Float32, Float64, Mask
from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..pictures import Scene
from ..pictures.settings import VISIBLE_SHARE
from ..scene import Camera, Gaussians, PinholeCamera, rotations_from_quats

_MAX_SIDE = 4096
"""Longest side, in pixels, at which a photo is read."""

_MAP_PIXELS = 350_000
"""Largest map of depths, in pixels. Finer maps cost time, and the Gaussians are hardly finer."""

_MARGIN = 0.08
"""Margin around the object in a map, as a share of its box."""

_TAIL = 0.002
"""Share of the Gaussians of an object, at each end of an axis of a picture, that its box leaves out."""

_SOLID = 0.5
"""Coverage by the object alone from which on a pixel shows its surface: half of the light comes from it."""

_CLEAR = 0.25  # chosen on museum_room
"""Coverage by the object alone below which nothing of it is on the ray. In between, the edge of the object is there."""

_MIN_SOLID_PIXELS = 60
"""Pixels of the surface that a photo has to show."""

_LAYER = 0.7
"""Standard deviations of the depths in a pixel behind its mean from which on a Gaussian belongs to the far side."""

_FLATTEST = 1e-3
"""Smallest axis of a Gaussian, as a share of its longest one: flatter ones have no direction to be cut along."""

_LAYER_COVER = 0.3
"""Coverage by the near side alone from which on its depth counts."""

_LAYER_SHARE = 0.01
"""The least of that, as a share of the object's size."""


@dataclass(frozen=True)
class DepthMap:
    """What one photo shows of an object.

    Attributes
    ----------
    camera : Camera
        Of the photo.
    part : PinholeCamera
        The part of the undistorted photo that shows the object, at the size of the maps, h x w.
    full : PinholeCamera
        The same part at the photo's own size.
    depth : array of shape [h, w], float32
        Depth of the object's surface along the view axis, in world units; 0 where the photo does not show it. In the
        maps of `depth_maps` it is the mean of the depths that are blended in a pixel.
    spread : array of shape [h, w], float32
        Standard deviation of the depths that are blended in a pixel, world units.
    free : array of shape [h, w], float32
        Depth up to which nothing of the object is, where `depth` is 0: infinite where the photo shows nothing.
    """

    camera: Camera
    part: PinholeCamera
    full: PinholeCamera
    depth: Float32
    spread: Float32
    free: Float32

    def nearer(self, by: float) -> DepthMap:
        """Return the map with its depths nearer by so many standard deviations."""
        return replace(self, depth=np.where(self.depth > 0, self.depth - by * self.spread, 0).astype(np.float32))


def depth_maps(
    scene: Scene,
    members: Mask,
    cameras: Sequence[Camera],
    *,
    should_stop: StopCheck,
) -> list[DepthMap]:
    """Return the maps of the photos that show an object.

    Parameters
    ----------
    scene : Scene
        The whole scene, with the object as it is shown: what hides it hides it here.
    members : array of shape [N], bool
        The object's Gaussians.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.

    Notes
    -----
    The depth of a Gaussian in a pixel is where its density along the ray is highest, linearised around its centre:
    z(u) = z0 - z0^2 (P m)_xy . (u - u0) / (m' P m), with the centre m and the inverse covariance P in the camera's
    frame and u = (x/z, y/z). It is linear in the pixel, so that three blended channels give the blended depth, and six
    its square. The depth of the centres instead makes a bump of each Gaussian. Gaussians behind what was found first
    are left out in a second pass, as their share in a translucent front would move it inward.
    """
    alone = replace(scene.gaussians[np.flatnonzero(members)], features=None)
    size = float(np.linalg.norm(np.ptp(np.quantile(alone.means, (0.05, 0.95), axis=0), axis=0)))
    maps = []
    for camera in cameras:
        if should_stop():
            raise Cancelled("Stopped while meshing; nothing was stored.")
        found = _part_of(camera, alone)
        if found is None:
            continue
        part, full = found
        made = _map(scene, members, alone, size, part)
        if (made[0] > 0).sum() >= _MIN_SOLID_PIXELS:
            maps.append(DepthMap(camera, part, full, *made))
    return maps


def surface_points(one: DepthMap, *, step: int = 1) -> Float64:
    """Return the places of the surface that a map shows, [P, 3], of every `step`-th row and column."""
    rows, columns = np.nonzero(one.depth[::step, ::step])
    rows, columns = rows * step, columns * step
    return one.part.places(rows, columns, one.depth[rows, columns])


def _part_of(camera: Camera, alone: Gaussians) -> tuple[PinholeCamera, PinholeCamera] | None:
    """Return the part of a photo that may show the object, at the size of the maps and at its own; None without any."""
    frame = training_pinhole(camera, max_side=_MAX_SIDE)
    local = alone.means.astype(np.float64) @ frame.viewmat[:3, :3].T + frame.viewmat[:3, 3]
    front = local[:, 2] > 1e-3
    if front.sum() < max(1, 0.5 * len(local)):
        return None
    pixels = local[front, :2] / local[front, 2:] * np.diag(frame.K)[:2] + frame.K[:2, 2]
    low, high = np.quantile(pixels, (_TAIL, 1 - _TAIL), axis=0)
    margin = _MARGIN * (high - low) + 4
    left, top = np.maximum(np.floor(low - margin), 0).astype(int)
    right, bottom = np.minimum(np.ceil(high + margin), (frame.width, frame.height)).astype(int)
    if right - left < 8 or bottom - top < 8:
        return None
    full = frame.part(left, top, int(right - left), int(bottom - top))
    return full.scaled(min(1.0, math.sqrt(_MAP_PIXELS / (full.width * full.height)))), full


def _map(
    scene: Scene, members: Mask, alone: Gaussians, size: float, part: PinholeCamera
) -> tuple[Float32, Float32, Float32]:
    """Return depth, spread and free depth of one photo."""
    seen = scene.render(part, channels=np.column_stack([members, scene.depth_of(part)]).astype(np.float32))
    share, scene_depth = seen.channels[..., 0], seen.channels[..., 1] / np.maximum(seen.alpha, 1e-6)
    first, spread, alpha = _rendered_depth(scene, alone, part)
    front = _front(alone, part, first, spread, alpha, size)
    if not front.all():
        nearer, its_spread, its_alpha = _rendered_depth(scene, alone[np.flatnonzero(front)], part)
        use = its_alpha > _LAYER_COVER
        first, spread = np.where(use, nearer, first), np.where(use, its_spread, spread)
    solid = (alpha > _SOLID) & (share > VISIBLE_SHARE * alpha) & (first > 0)
    depth = np.where(solid, first, 0).astype(np.float32)
    shows = seen.alpha > _SOLID
    hidden = shows & (alpha >= _CLEAR) & (scene_depth < first)
    free = np.where(hidden | ((alpha < _CLEAR) & shows), scene_depth, 0)
    free = np.where((alpha < _CLEAR) & ~shows, np.inf, free)
    return depth, spread.astype(np.float32), np.where(solid, 0, free).astype(np.float32)


def _rendered_depth(scene: Scene, gaussians: Gaussians, part: PinholeCamera) -> tuple[Float32, Float32, Float32]:
    """Return the blended depth of the surfaces of Gaussians, its standard deviation, and the coverage, [h, w] each."""
    planes, middle = _planes(gaussians, part)
    a, b, c = planes.T
    channels = np.column_stack([planes, a * a, b * b, c * c, a * b, a * c, b * c]).astype(np.float32)
    rendered = scene.with_gaussians(gaussians).render(part, channels=channels)
    values = np.moveaxis(rendered.channels / np.maximum(rendered.alpha, 1e-6)[..., None], 2, 0).astype(np.float64)
    x = ((np.arange(part.width) + 0.5 - part.width / 2) / part.K[0, 0])[None, :]
    y = ((np.arange(part.height) + 0.5 - part.height / 2) / part.K[1, 1])[:, None]
    depth = values[0] + values[1] * x + values[2] * y
    square = values[3] + values[4] * x * x + values[5] * y * y
    square += 2 * (values[6] * x + values[7] * y + values[8] * x * y)
    spread = np.sqrt(np.maximum(square - depth * depth, 0))
    return (depth + middle).astype(np.float32), spread.astype(np.float32), rendered.alpha


def _planes(gaussians: Gaussians, part: PinholeCamera) -> tuple[Float64, float]:
    """Return for each Gaussian, [N, 3], the depth amid the picture, and its change per unit of x/z and of y/z.

    Depths are relative to the second result, so that float32 keeps the squares' digits.
    """
    rotation, shift = part.viewmat[:3, :3], part.viewmat[:3, 3]
    local = gaussians.means.astype(np.float64) @ rotation.T + shift
    axes = rotation @ rotations_from_quats(gaussians.quats.astype(np.float64))
    scales = gaussians.scales.astype(np.float64)
    scales = np.maximum(scales, _FLATTEST * scales.max(axis=1, keepdims=True))
    in_axes = np.einsum("nij,ni->nj", axes, local) / scales
    along = np.einsum("nij,nj->ni", axes, in_axes / scales)  # P m
    depths = np.maximum(local[:, 2], 1e-6)
    slopes = -(depths**2 / np.einsum("ni,ni->n", in_axes, in_axes))[:, None] * along[:, :2]
    # Relative to the ray through the middle of the part, where numbers are small.
    amid = (np.array([part.width, part.height]) / 2 - part.K[:2, 2]) / np.diag(part.K)[:2]
    offset = local[:, :2] / depths[:, None] - amid
    middle = float(np.median(depths))
    return np.column_stack([depths - (slopes * offset).sum(axis=1) - middle, slopes]), middle


def _front(
    gaussians: Gaussians, part: PinholeCamera, depth: Float32, spread: Float32, alpha: Float32, size: float
) -> Mask:
    """Return which Gaussians are not behind the surface that was found first, [N]."""
    rows, pixels, depths = part.project(gaussians.means.astype(np.float64))
    x, y = pixels.astype(int).T
    behind = depths - depth[y, x] > np.maximum(_LAYER * spread[y, x], _LAYER_SHARE * size)
    front = np.ones(len(gaussians), bool)
    front[rows[behind & (alpha[y, x] > _SOLID)]] = False
    return front
