"""The surface at a position of a window: rays through splats that stand anywhere in Blender's world. No bpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float64
from ...engine.core.errors import CameraError, ObjectError
from ...engine.scene import RayCaster, RayHits


@dataclass(frozen=True)
class Sight:
    """The view of a region of the window, or of a photo.

    Attributes
    ----------
    width, height : int
        Size in pixels.
    window_from_world : array of shape [4, 4], float64
        Blender's ``RegionView3D.perspective_matrix``: homogeneous, -1 to 1 across the region, Y up.
    """

    width: int
    height: int
    window_from_world: Float64

    def ray(self, x: float, y: float) -> tuple[Float64, Float64]:
        """Return origin and direction of the ray seen at (x, y), in pixels from the lower left corner, in the world."""
        return ray_through(self.window_from_world, 2.0 * x / self.width - 1.0, 2.0 * y / self.height - 1.0)

    def positions(self, points: NDArray[np.floating]) -> Float64:
        """Return where world points [N, 3] are seen, [N, 2], pixels from the lower left corner; NaN behind the eye."""
        rows = self.window_from_world
        homogeneous = points.astype(np.float64) @ rows[:, :3].T + rows[:, 3]
        depth = homogeneous[:, 3:]
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = np.where(depth > 1e-9, homogeneous[:, :2] / depth, np.nan)
        return (unit + 1.0) * (self.width / 2.0, self.height / 2.0)

    def may_show(self, shapes: Float64, place: tuple[float, float], reach: float) -> NDArray[np.bool_]:
        """Return which shapes may be seen within `reach` pixels of a place, shape [S].

        Parameters
        ----------
        shapes : array of shape [S, P, 3]
            Convex shapes of P corners in the world. For lines, P = 2, the answer is exact within a square of twice
            `reach`; other shapes may be farther away.
        place : (float, float)
            Pixels from the lower left corner.
        """
        rows, size = self.window_from_world, np.array([self.width, self.height])
        corners = shapes @ rows[[0, 1, 3], :3].T + rows[[0, 1, 3], 3]
        low, high = (2.0 * (np.array(place) + side) / size - 1.0 for side in (-reach, reach))
        # Homogeneous, so that what is partly behind the eye counts with the part before it.
        depth = corners[..., 2:]
        outside = (corners[..., :2] < low * depth).all(axis=1) | (corners[..., :2] > high * depth).all(axis=1)
        hidden = outside.any(axis=1) | (depth[..., 0] <= 0).all(axis=1)
        if shapes.shape[1] == 2:
            line = np.cross(corners[:, 0], corners[:, 1])
            square = np.array([[x, y, 1.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
            sides = line @ square.T
            hidden |= (sides < 0).all(axis=1) | (sides > 0).all(axis=1)
        return ~hidden


def ray_through(window_from_world: Float64, u: float, v: float) -> tuple[Float64, Float64]:
    """Return origin [3] and unit direction [3] of the ray at (u, v), -1 to 1 across a view, in perspective or not.

    Raises
    ------
    CameraError
        When the view is flattened.
    """
    rows = window_from_world
    # Two planes contain the line of sight. Unlike unprojecting two points, this keeps the precision of a float32 matrix
    # with a near clipping plane.
    planes = np.stack([rows[0] - u * rows[3], rows[1] - v * rows[3]])
    direction = np.cross(planes[0, :3], planes[1, :3])
    length = np.linalg.norm(direction)
    if not (np.isfinite(length) and length > 0):
        raise CameraError("The view is flattened. Give the camera a scale other than 0.")
    direction /= length
    is_perspective = np.linalg.norm(rows[3, :3]) > 1e-9
    # Depth grows away from the eye.
    axis = rows[3, :3] if is_perspective else rows[2, :3]
    direction = direction if axis @ direction > 0 else -direction
    start = np.linalg.lstsq(planes[:, :3], -planes[:, 3], rcond=None)[0]
    if is_perspective:
        # The eye, where the homogeneous coordinate is 0.
        start = start - direction * (rows[3, :3] @ start + rows[3, 3]) / (rows[3, :3] @ direction)
    else:
        # The near clipping plane.
        start = start - direction * (rows[2, :3] @ start + rows[2, 3] + 1.0) / (rows[2, :3] @ direction)
    return start, direction


@dataclass(frozen=True)
class SplatLayer:
    """The visible Gaussians of a splat object.

    Attributes
    ----------
    name : str
        Name of the Blender object.
    caster : RayCaster
        Of its N visible Gaussians, in its own frame.
    world_from_own : array of shape [4, 4], float64
    labels : array of shape [N], int
        Which object each Gaussian belongs to, as an index into a list of the caller; -1 for none.
    vertices : array of shape [N], int
        Vertex of each Gaussian in the mesh.
    """

    name: str
    caster: RayCaster
    world_from_own: Float64
    labels: NDArray[np.integer]
    vertices: NDArray[np.integer]


@dataclass(frozen=True)
class Seen:
    """The hit of a ray.

    Attributes
    ----------
    label : int
        Object with the largest share in what the eye sees; -1 for none.
    share : float
        Its share, 0 to 1.
    point : array of shape [3] or None
        Position of the surface in the world; None where more than half of the light passes.
    """

    label: int
    share: float
    point: Float64 | None


def seen_on_ray(layers: Sequence[SplatLayer], origin: Float64, direction: Float64) -> Seen:
    """Return what the ray from `origin` along the unit vector `direction`, both [3], in the world, meets in `layers`.

    Raises
    ------
    ObjectError
        When a layer is flattened.
    """
    found: list[tuple[Float64, Float64, NDArray[np.integer]]] = []
    for layer in layers:
        hits, stretch = _cast(layer, origin, direction)
        found.append((hits.distances / stretch, hits.alphas, layer.labels[hits.rows]))
    distances, alphas, labels = (np.concatenate(parts) for parts in zip(*found, strict=True)) if found else [()] * 3
    order = np.argsort(distances, kind="stable") if len(layers) > 1 else np.arange(len(distances))
    hits = RayHits(order.astype(np.int64), np.asarray(distances)[order], np.asarray(alphas)[order])
    if not len(order):
        return Seen(-1, 0.0, None)
    shares = np.bincount(np.asarray(labels)[order] + 1, hits.weights)
    label = int(shares.argmax()) - 1
    distance = hits.surface
    return Seen(label, float(shares.max()), None if distance is None else origin + distance * direction)


def _cast(layer: SplatLayer, origin: Float64, direction: Float64) -> tuple[RayHits, float]:
    """Return the hits of a ray in a layer, and the length of a unit of the world along it in the layer's frame."""
    try:
        own_from_world = np.linalg.inv(layer.world_from_own)
    except np.linalg.LinAlgError as error:
        raise ObjectError(f"{layer.name} is flattened. Give it a scale other than 0.") from error
    own_direction = own_from_world[:3, :3] @ direction
    own_origin = own_from_world[:3, :3] @ origin + own_from_world[:3, 3]
    return layer.caster.cast(own_origin, own_direction), float(np.linalg.norm(own_direction))


def inside_polygon(points: Float64, corners: Float64) -> NDArray[np.bool_]:
    """Return which of `points` [N, 2] are inside of the closed polygon `corners` [C, 2], by the even-odd rule.

    Points with NaN are outside.
    """
    inside = np.zeros(len(points), bool)
    x, y = points[:, 0], points[:, 1]
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        crosses = (y0 > y) != (y1 > y)
        inside ^= crosses & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
    return inside & np.isfinite(points).all(axis=1)
