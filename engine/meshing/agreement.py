"""How well the photos agree with a surface, and the depths that they agree with best.

Gaussians of round things lie inside of what they show, those of flat things in it. So how much nearer than the blended
depth the surface is depends on the object, and photos tell it: the right surface is seen alike by all of them, and its
outlines are those of the object.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numba import njit

from ..core.arrays import Float32, Float64
from ..core.events import StopCheck
from ..objects import DetailPhotos, read_part
from ..rasterizer import JIT, Share, run_shared, take_range
from .cleaning import main_parts, used_vertices, vertex_normals
from .depth import DepthMap
from .drawing import mesh_depth
from .fusion import fuse
from .surface import extract_surface

_TOWARD = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
"""Standard deviations of the depths in a pixel, by which the surface may be nearer than their mean."""

_OUTLINE = 0.9  # chosen on room_1
"""Weight of the pixels that the object covers and the surface does not, beside the disagreement of the photos."""

_MAP_PIXELS, _MAX_VOXELS = 20_000, 1_000_000
"""Largest maps and largest grid of the surfaces that are compared: one number is sought, not a surface."""

_MAX_POINTS = 30_000
"""Points of a surface at which photos are compared."""

_TOLERANCE = 3.0
"""Voxels behind the surface within which a point is visible."""

_MIN_COSINE = 0.3
"""Cosine of the angle at which a photo sees a point, below which it is not compared."""

_MAX_PHOTOS, _BEST = 12, 0.6
"""Photos that are compared at a point, the nearest and most frontal ones, and the share of them that agrees best and
counts: highlights and what hides the object differ in the others."""

_NOISE = 0.012
"""Noise of the photos, as a share of white: what has less contrast tells nothing."""

_REACH, _SIDE = 2, 5
"""Pixels of a patch around a point on each side, and in all: 2 * _REACH + 1."""

_POINTS_PER_RANGE = 512
"""Points that a thread processes before it takes the next ones."""


def agreeing_depths(
    maps: Sequence[DepthMap], photos: DetailPhotos, *, should_stop: StopCheck
) -> tuple[list[DepthMap], float]:
    """Return the maps with the depths that photos and outlines agree with best, and how much nearer they are.

    Parameters
    ----------
    maps : sequence of DepthMap
        With the mean of the depths in each pixel.

    Returns
    -------
    maps : list of DepthMap
    toward : float
        In standard deviations of the depths in a pixel.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    ObjectError
        When the photos show no extent.
    PhotoError
        When a photo cannot be read.
    """
    small = [_reduced(one) for one in maps]
    images = [_brightness(one, photos) for one in small]
    scores = [_disagreement([one.nearer(by) for one in small], images, should_stop) for by in _TOWARD]
    best = _TOWARD[int(np.argmin(scores))]
    return [one.nearer(best) for one in maps], best


def _reduced(one: DepthMap) -> DepthMap:
    """Return a map of every k-th pixel, of at most about `_MAP_PIXELS`."""
    k = math.ceil(math.sqrt(one.depth.size / _MAP_PIXELS))
    depth, spread, free = (np.ascontiguousarray(values[::k, ::k]) for values in (one.depth, one.spread, one.free))
    K = one.part.K / np.array([[k], [k], [1]])
    K[:2, 2] += 0.5 - 0.5 / k
    part = replace(one.part, K=K, width=depth.shape[1], height=depth.shape[0])
    return replace(one, part=part, depth=depth, spread=spread, free=free)


def _brightness(one: DepthMap, photos: DetailPhotos) -> Float32:
    """Return the brightness of a photo in the pixels of a map, 0 to 1, [h, w]."""
    pixels, _ = read_part(photos, one.camera, one.part, one.part)
    colors = pixels.astype(np.float32) / (255 * photos.gain(one.camera.photo))
    return np.ascontiguousarray(colors @ np.array([0.3, 0.55, 0.15], np.float32))


def _disagreement(maps: Sequence[DepthMap], images: Sequence[Float32], should_stop: StopCheck) -> float:
    """Return how little photos and outlines agree with the fused surface: 0 for perfect agreement, about 1 for none."""
    field = fuse(maps, should_stop=should_stop, max_voxels=_MAX_VOXELS)
    vertices, faces, known = extract_surface(field)
    faces = faces[known[faces].all(axis=1)]
    if not len(faces):
        return math.inf
    vertices, faces = used_vertices(vertices, faces[main_parts(vertices, faces, np.ones(len(faces), bool))])
    depths = [mesh_depth(one.part, vertices, faces) for one in maps]
    missing = sum(float(((one.depth > 0) & np.isinf(depth)).sum()) for one, depth in zip(maps, depths, strict=True))
    covered = sum(float((one.depth > 0).sum()) for one in maps)
    step = math.ceil(len(vertices) / _MAX_POINTS)
    normals = vertex_normals(vertices, faces)[::step].astype(np.float64)
    costs = _differences(vertices[::step], normals, maps, images, depths, _TOLERANCE * field.voxel)
    compared = costs[costs >= 0]
    return (float(compared.mean()) if len(compared) else 1.0) + _OUTLINE * missing / covered


def _differences(
    places: Float64,
    normals: Float64,
    maps: Sequence[DepthMap],
    images: Sequence[Float32],
    depths: Sequence[Float32],
    tolerance: float,
) -> Float32:
    """Return 1 minus the correlation of the photos around each point, [P]; -1 where fewer than two show it."""
    cameras = [one.part for one in maps]
    lenses = np.array([[c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2], c.width, c.height] for c in cameras])
    viewmats, centers = np.array([c.viewmat[:3] for c in cameras]), np.array([c.center for c in cameras])
    starts = np.cumsum([0] + [c.width * c.height for c in cameras])
    pixels, surface = (np.concatenate([one.ravel() for one in values]) for values in (images, depths))
    spacing = float(np.median([np.median(one.depth[one.depth > 0]) / one.part.K[0, 0] for one in maps]))
    costs = np.full(len(places), -1, np.float32)

    def work(share: Share) -> None:
        _compare(
            share, places, normals, spacing, tolerance, viewmats, centers, lenses, starts, pixels, surface, costs,
            _MIN_COSINE, _MAX_PHOTOS, _BEST, np.float32(_SIDE**2 * _NOISE**2),
        )  # fmt: skip

    run_shared(work, None)
    return costs


@njit(**JIT)
def _compare(  # type: ignore[no-untyped-def]
    share, places, normals, spacing, tolerance, viewmats, centers, lenses, starts, pixels, surface, costs, min_cosine,
    max_photos, best, noise,
):  # fmt: skip
    n_views = len(viewmats)
    weights, agreement = np.zeros(n_views), np.zeros(max_photos)
    patches, total = np.zeros((max_photos, _SIDE * _SIDE), np.float32), np.zeros(_SIDE * _SIDE, np.float32)
    right, up, point = np.zeros(3), np.zeros(3), np.zeros(3)
    while True:
        first, last = take_range(share, len(places), _POINTS_PER_RANGE)
        if first >= last:
            return
        for i in range(first, last):
            n, p = normals[i], places[i]
            if abs(n[0]) < 0.6:
                right[0], right[1], right[2] = 0.0, n[2], -n[1]
            else:
                right[0], right[1], right[2] = -n[2], 0.0, n[0]
            right *= spacing / np.sqrt(right[0] ** 2 + right[1] ** 2 + right[2] ** 2)
            up[0] = n[1] * right[2] - n[2] * right[1]
            up[1] = n[2] * right[0] - n[0] * right[2]
            up[2] = n[0] * right[1] - n[1] * right[0]
            for view in range(n_views):
                weights[view] = 0
                dx, dy, dz = centers[view, 0] - p[0], centers[view, 1] - p[1], centers[view, 2] - p[2]
                cosine = (n[0] * dx + n[1] * dy + n[2] * dz) / np.sqrt(dx * dx + dy * dy + dz * dz)
                if cosine < min_cosine:
                    continue
                z, u, v = _pixel_of(viewmats[view], lenses[view], p)
                width, height = int(lenses[view, 4]), int(lenses[view, 5])
                if z <= 1e-6 or not (0 <= u < width and 0 <= v < height):
                    continue
                if z <= surface[starts[view] + int(v) * width + int(u)] + tolerance:
                    weights[view] = cosine * lenses[view, 0] / z
            count = 0
            total[:] = 0
            while count < max_photos:
                chosen = weights.argmax()
                if weights[chosen] == 0:
                    break
                weights[chosen] = 0
                width, height = int(lenses[chosen, 4]), int(lenses[chosen, 5])
                mean = np.float32(0)
                for a in range(_SIDE):
                    for b in range(_SIDE):
                        for k in range(3):
                            point[k] = p[k] + (a - _REACH) * right[k] + (b - _REACH) * up[k]
                        _, u, v = _pixel_of(viewmats[chosen], lenses[chosen], point)
                        value = _between(pixels, starts[chosen], width, height, u - 0.5, v - 0.5)
                        patches[count, a * _SIDE + b] = value
                        mean += value
                mean /= _SIDE * _SIDE
                square = noise
                for q in range(_SIDE * _SIDE):
                    patches[count, q] -= mean
                    square += patches[count, q] * patches[count, q]
                for q in range(_SIDE * _SIDE):
                    patches[count, q] /= np.sqrt(square)
                    total[q] += patches[count, q]
                count += 1
            if count < 2:
                continue
            for j in range(count):
                agreement[j] = (patches[j] * (total - patches[j])).sum() / (count - 1)
            used = max(2, int(np.ceil(best * count)))
            costs[i] = 1 - np.sort(agreement[:count])[count - used :].mean()


@njit(**JIT)
def _pixel_of(viewmat, lens, p):  # type: ignore[no-untyped-def]
    """Return depth, column and row of a point."""
    x = viewmat[0, 0] * p[0] + viewmat[0, 1] * p[1] + viewmat[0, 2] * p[2] + viewmat[0, 3]
    y = viewmat[1, 0] * p[0] + viewmat[1, 1] * p[1] + viewmat[1, 2] * p[2] + viewmat[1, 3]
    z = viewmat[2, 0] * p[0] + viewmat[2, 1] * p[1] + viewmat[2, 2] * p[2] + viewmat[2, 3]
    return z, lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]


@njit(**JIT)
def _between(pixels, start, width, height, u, v):  # type: ignore[no-untyped-def]
    """Return the brightness between four pixels, at the nearest place of the picture."""
    u, v = min(max(u, 0.0), width - 1.001), min(max(v, 0.0), height - 1.001)
    column, row = int(u), int(v)
    s, t = np.float32(u - column), np.float32(v - row)
    q = start + row * width + column
    upper = pixels[q] + s * (pixels[q + 1] - pixels[q])
    lower = pixels[q + width] + s * (pixels[q + width + 1] - pixels[q + width])
    return upper + t * (lower - upper)
