"""Colours of a surface from the photos that saw it, at their own resolution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import cg

from ..core.arrays import Float32, Float64, Int32, Mask
from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..objects import DetailPhotos, read_part
from ..rasterizer import JIT, Share, run_shared, take_range
from ..scene import PinholeCamera
from .depth import DepthMap
from .drawing import mesh_depth

_PIXELS_PER_TEXEL = 1.5
"""Photos are read at most so much finer than the texture."""

_MIN_COSINE = 0.2
"""Cosine of the angle at which a photo sees a surface, below which its colours are not used."""

_SHARP = 4.0  # chosen on room_1
"""Power of a photo's resolution on the surface by which it counts in the sharp part of colours. In the blurred part all
count alike: the mean of all photos holds the least of the highlights, which move with the camera."""

_BLUR = 1 / 60
"""Standard deviation of the blurred part, as a share of the longer side of the part that shows the object."""

_EDGE, _FEATHER = 0.5, 0.02  # chosen on room_1
"""Pixels of a map beside an edge of depth that are not used, and the share of its longer side over which photos count
less and less."""

_POINTS_PER_RANGE = 4096
"""Points that a thread processes before it takes the next ones."""


@dataclass(frozen=True)
class SurfacePoints:
    """P points whose colours are wanted.

    Attributes
    ----------
    places, normals : arrays of shape [P, 3], float32
    seen : array of shape [P], bool
        Whether photos saw the surface there. The others get no colour.
    """

    places: Float32
    normals: Float32
    seen: Mask


def colors_of(
    points: SurfacePoints,
    vertices: Float64,
    faces: Int32,
    maps: Sequence[DepthMap],
    photos: DetailPhotos,
    *,
    texel: float,
    tolerance: float,
    should_stop: StopCheck,
    tell: Callable[[float], None],
) -> tuple[Float32, Mask]:
    """Return the colour of each point, [P, 3], sRGB from 0 to 1, and which have one, [P].

    Parameters
    ----------
    vertices, faces : array
        The surface, which hides parts of itself.
    texel : float
        Size of a pixel of the texture on the surface, world units.
    tolerance : float
        Distance behind the surface within which a point is visible, world units.
    tell : callable
        Called with the fraction that is done, 0 to 1.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    PhotoError
        When a photo cannot be read.

    Notes
    -----
    Baumberg 2002: the blurred part of the colours is the mean of all photos, which hides what differs between their
    exposures. What is sharp comes mostly from the best photos, as mixtures of photos are blurred where
    cameras or surface are off by a pixel. Weights have no jumps along the surface, so that there are no seams.
    """
    soft, sharp = np.zeros((2, len(points.places), 4), np.float32)
    eligible = np.flatnonzero(points.seen)
    places = points.places[eligible].astype(np.float64)
    normals = points.normals[eligible].astype(np.float64)
    sums = [one[eligible] for one in (soft, sharp)]
    typical = np.median([one.full.K[0, 0] / float(np.median(one.depth[one.depth > 0])) for one in maps])
    for number, one in enumerate(maps):
        if should_stop():
            raise Cancelled("Stopped while meshing; nothing was stored.")
        depth = mesh_depth(one.part, vertices, faces)
        usable = _usable(one, depth, tolerance)
        part = _read_size(one, texel)
        pixels, valid = read_part(photos, one.camera, part, one.part)
        usable *= valid
        image = np.clip(pixels / (np.float32(255) * photos.gain(one.camera.photo)), 0, 1).astype(np.float32)
        blurred = cv2.GaussianBlur(image, (0, 0), _BLUR * max(part.width, part.height))
        ratio = np.array([part.width / one.part.width, part.height / one.part.height])
        lens = np.array([one.part.K[0, 0], one.part.K[1, 1], one.part.K[0, 2], one.part.K[1, 2]])
        resolution = one.full.K[0, 0] / typical
        viewmat, center = one.part.viewmat[:3], one.part.center

        def work(
            share: Share,
            arguments: tuple[object, ...] = (viewmat, center, lens, depth, usable, image, blurred, ratio, resolution),
        ) -> None:
            _add_photo(share, places, normals, *sums, *arguments, tolerance, _MIN_COSINE, _SHARP)

        run_shared(work, None)
        tell((number + 1) / len(maps))
    has = (sums[0][:, 3] > 0) & (sums[1][:, 3] > 0)
    low, high = (one[has, :3] / one[has, 3:] for one in sums)
    colors = np.zeros((len(points.places), 3), np.float32)
    known = np.zeros(len(points.places), bool)
    colors[eligible[has]] = np.clip(low + high, 0, 1)
    known[eligible[has]] = True
    return colors, known


def spread_colors(vertices: Float64, faces: Int32, colors: Float32, known: Mask) -> Float32:
    """Return colours of all vertices, [V, 3]: those without one get the mean of their neighbours.

    Vertices of parts on which no vertex has a colour are grey.
    """
    n = len(vertices)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    both = np.concatenate([ends, ends[:, ::-1]])
    adjacency = coo_matrix((np.ones(len(both), np.float32), (both[:, 0], both[:, 1])), shape=(n, n)).tocsr()
    unknown = np.flatnonzero(~known)
    result = colors.copy()
    if not len(unknown):
        return result
    mean = colors[known].mean(axis=0) if known.any() else np.full(3, 0.5, np.float32)
    inner, outer = adjacency[unknown][:, unknown], adjacency[unknown][:, np.flatnonzero(known)]
    # A little of the mean keeps the system regular where nothing near is known.
    weight = 1e-4
    degree = np.asarray(adjacency[unknown].sum(axis=1)).ravel() + weight
    system = diags(degree) - inner
    for channel in range(3):
        right = outer @ colors[known, channel] + weight * mean[channel]
        solution, _ = cg(system, right, x0=np.full(len(unknown), mean[channel]), rtol=1e-4, maxiter=400)
        result[unknown, channel] = np.clip(solution, 0, 1)
    return result


def _read_size(one: DepthMap, texel: float) -> PinholeCamera:
    """Return the part of a photo at the size at which it is read."""
    pixel = float(np.median(one.depth[one.depth > 0])) / one.full.K[0, 0]
    return one.full.scaled(min(1.0, _PIXELS_PER_TEXEL * pixel / max(texel, 1e-12)))


def _usable(one: DepthMap, depth: Float32, tolerance: float) -> Float32:
    """Return how much the colours of each pixel of a map count, 0 to 1: less near the edges of what it shows."""
    shown = (one.depth > 0) & np.isfinite(depth)
    near = np.where(shown, depth, 0).astype(np.float32)
    kernel = np.ones((3, 3), np.uint8)
    jump = cv2.dilate(near, kernel) - cv2.erode(near, kernel)
    inside = shown & (jump < 4 * tolerance)
    padded = np.pad(inside.astype(np.uint8), 1)
    distance = cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1]
    return np.clip((distance - _EDGE) / max(1.0, _FEATHER * max(shown.shape)), 0, 1).astype(np.float32)


@njit(**JIT)
def _add_photo(  # type: ignore[no-untyped-def]
    share, places, normals, soft, sharp, viewmat, center, lens, depth, usable, image, blurred, ratio, resolution,
    tolerance, min_cosine, sharp_power,
):  # fmt: skip
    height, width = depth.shape
    fx, fy, cx, cy = lens
    color, base = np.zeros(3, np.float32), np.zeros(3, np.float32)
    while True:
        first, last = take_range(share, len(places), _POINTS_PER_RANGE)
        if first >= last:
            return
        for i in range(first, last):
            px, py, pz = places[i]
            z = viewmat[2, 0] * px + viewmat[2, 1] * py + viewmat[2, 2] * pz + viewmat[2, 3]
            if z <= 1e-6:
                continue
            u = fx * (viewmat[0, 0] * px + viewmat[0, 1] * py + viewmat[0, 2] * pz + viewmat[0, 3]) / z + cx
            v = fy * (viewmat[1, 0] * px + viewmat[1, 1] * py + viewmat[1, 2] * pz + viewmat[1, 3]) / z + cy
            if not (0 <= u < width and 0 <= v < height):
                continue
            weight = usable[int(v), int(u)]
            if weight == 0 or z > depth[int(v), int(u)] + tolerance:
                continue
            dx, dy, dz = center[0] - px, center[1] - py, center[2] - pz
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            cosine = (normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz) / distance
            if cosine < min_cosine:
                continue
            _sample(image, u * ratio[0], v * ratio[1], color)
            _sample(blurred, u * ratio[0], v * ratio[1], base)
            quality = cosine * resolution / z
            sharp_weight = weight * quality**sharp_power
            for k in range(3):
                soft[i, k] += weight * base[k]
                sharp[i, k] += sharp_weight * (color[k] - base[k])
            soft[i, 3] += weight
            sharp[i, 3] += sharp_weight


@njit(**JIT)
def _sample(image, u, v, color):  # type: ignore[no-untyped-def]
    height, width = image.shape[:2]
    u, v = min(max(u - 0.5, 0.0), width - 1.0), min(max(v - 0.5, 0.0), height - 1.0)
    column, row = min(int(u), max(width - 2, 0)), min(int(v), max(height - 2, 0))
    right, below = min(column + 1, width - 1), min(row + 1, height - 1)
    s, t = u - column, v - row
    for k in range(3):
        upper = (1 - s) * image[row, column, k] + s * image[row, right, k]
        lower = (1 - s) * image[below, column, k] + s * image[below, right, k]
        color[k] = (1 - t) * upper + t * lower
