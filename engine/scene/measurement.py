"""Scale, ground, north and origin of a scene as measured by the user, and the frames of exported files. NumPy only.

Photos alone give a scene without a unit. Distances between pairs of points, measured on the real objects, give its
scale; points on the floor give the ground, and two points its north. Points are in the normalised world, see
`engine.scene.camera`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Float64
from .camera import MAX_COORDINATE, CameraSet, similarity_scale

Point = tuple[float, float, float]
"""A position in the normalised world."""

_MAX_METRES = 1e7
"""Longest distance: beyond it no scene on Earth is measured in a straight line."""
_MIN_LENGTH = 1e-9
"""Shortest distance between two points, world units: float64 holds no direction between nearer ones."""
_MIN_SPREAD = 0.02
"""Smallest width of the points of a ground relative to their length, about 1 degree: nearer to a line, no plane."""


@dataclass(frozen=True)
class MeasuredDistance:
    """A distance between two points that the user knows.

    Attributes
    ----------
    first, second : Point
        Ends in the normalised world.
    metres : float
        Distance in metres, above 0.
    """

    first: Point
    second: Point
    metres: float

    @property
    def units(self) -> float:
        """Distance in units of the normalised world."""
        return math.dist(self.first, self.second)


@dataclass(frozen=True)
class Measurement:
    """Measurements of the user in a scene. Without any, the scene is upright, and its unit is unknown.

    Attributes
    ----------
    distances : tuple of MeasuredDistance
        Known distances, which give the scale.
    ground : tuple of Point
        Three or more points of the ground, not on a line; empty for the estimate of `engine.cameras.normalise`.
    north : (Point, Point) or None
        Two points, the second to the north of the first.
    origin : Point or None
        Origin of the measured frame.
    """

    distances: tuple[MeasuredDistance, ...] = ()
    ground: tuple[Point, ...] = ()
    north: tuple[Point, Point] | None = None
    origin: Point | None = None

    @property
    def is_empty(self) -> bool:
        """Whether nothing was measured."""
        return self == Measurement()

    @property
    def metres_per_unit(self) -> float | None:
        """Metres in one unit of the normalised world, the least-squares fit to all distances; None without one.

        The fit minimises the squared differences in metres. The points are picked with an error that does not depend
        on the distance, so longer distances count more.
        """
        if not self.distances:
            return None
        units = np.array([distance.units for distance in self.distances])
        metres = np.array([distance.metres for distance in self.distances])
        # Relative to the largest, so that squares neither overflow nor vanish.
        relative = units / units.max()
        return float((relative @ metres) / (relative @ relative) / units.max())

    @property
    def residuals(self) -> tuple[float, ...]:
        """Of each distance, the length in the scaled scene minus the known one, metres."""
        scale = self.metres_per_unit or 0.0
        return tuple(scale * distance.units - distance.metres for distance in self.distances)

    @property
    def scale_residual(self) -> float | None:
        """Root mean square of `residuals`, metres; None for fewer than two distances, which agree with any scale."""
        if len(self.distances) < 2:
            return None
        return math.sqrt(sum(value * value for value in self.residuals) / len(self.distances))

    @property
    def ground_residual(self) -> float | None:
        """Root mean square distance of the points of the ground from it, world units; None without a ground."""
        if not self.ground:
            return None
        heights = (np.array(self.ground) - self._ground_point) @ self.up
        return math.sqrt(float(heights @ heights) / len(self.ground))

    @property
    def up(self) -> Float64:
        """Direction away from the ground as a unit vector of the normalised world, shape [3].

        It is on the side of the estimated up direction, which is Z.
        """
        if not self.ground:
            return np.array([0.0, 0.0, 1.0])
        normal = np.linalg.svd(np.array(self.ground) - self._ground_point)[2][2]
        up: Float64 = normal if normal[2] >= 0 else -normal
        return up

    @property
    def measured_from_world(self) -> Float64:
        """Similarity [4, 4] from the normalised world to the measured frame.

        The measured frame has Z up from the ground at height 0, Y to the north, and metres, each where it was
        measured; otherwise what the normalised world has. Without an origin of its own, the origin stays where it
        is, or comes down to the ground.
        """
        up = self.up
        north = np.array([0.0, 1.0, 0.0]) if self.north is None else np.subtract(self.north[1], self.north[0])
        y = _across(north, up)
        if self.north is None and np.linalg.norm(y) < 0.1:  # the ground is nearly across Y
            y = _across(np.array([1.0, 0.0, 0.0]), up)
        y /= np.linalg.norm(y)
        linear = (self.metres_per_unit or 1.0) * np.stack([np.cross(y, up), y, up])
        matrix = np.eye(4)
        matrix[:3, :3] = linear
        matrix[:3, 3] = -linear @ self._origin(up)
        return matrix

    def _origin(self, up: Float64) -> Float64:
        if self.origin is not None:
            return np.array(self.origin)
        return up * (up @ self._ground_point) if self.ground else np.zeros(3)

    @property
    def _ground_point(self) -> Float64:
        """Middle of the points of the ground, shape [3]."""
        center: Float64 = np.array(self.ground).mean(axis=0)
        return center


def measurement_problem(measurement: Measurement) -> str | None:
    """Return why `measurement` cannot be used, as a clause for a message; None for a usable one."""
    for number, distance in enumerate(measurement.distances, 1):
        if problem := _points_problem((distance.first, distance.second)):
            return f"of distance {number}, {problem}"
        # Written so that NaN fails.
        if not 0.0 < distance.metres <= _MAX_METRES:
            return f"distance {number} must be above 0 and at most {_MAX_METRES:g} metres, got {distance.metres:g}"
    if problem := _ground_problem(measurement.ground):
        return problem
    if measurement.north is not None:
        if problem := _points_problem(measurement.north):
            return f"of north, {problem}"
        north = np.subtract(measurement.north[1], measurement.north[0])
        if np.linalg.norm(_across(north, measurement.up)) < _MIN_SPREAD * np.linalg.norm(north):
            return "the two points of north lie above one another"
    if measurement.origin is not None and not _are_usable([measurement.origin]):
        return "the origin is not finite or is too large"
    return None


def _ground_problem(ground: Sequence[Point]) -> str | None:
    if not ground:
        return None
    if len(ground) < 3:
        return f"the ground needs at least 3 points, got {len(ground)}"
    if not _are_usable(ground):
        return "a point of the ground is not finite or is too large"
    points = np.array(ground)
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[0] < _MIN_LENGTH or spread[1] < _MIN_SPREAD * spread[0]:
        return "the points of the ground lie on a line, so they give no plane"
    return None


def _points_problem(points: tuple[Point, Point]) -> str | None:
    if not _are_usable(points):
        return "a point is not finite or is too large"
    return "both points are the same" if math.dist(*points) < _MIN_LENGTH else None


def _are_usable(points: Sequence[Point]) -> bool:
    return all(math.isfinite(value) and abs(value) <= MAX_COORDINATE for point in points for value in point)


def _across(vector: Float64, up: Float64) -> Float64:
    """Return the part of `vector` that is perpendicular to the unit vector `up`."""
    part: Float64 = vector - (vector @ up) * up
    return part


@dataclass(frozen=True)
class ExportFrame:
    """The frame in which a file is written.

    Attributes
    ----------
    name : str
        ``"measured"``, ``"upright"`` or ``"original"``, see `export_frame`; ``"placed"`` by another program.
    from_world : array of shape [4, 4], float64
        Similarity from the normalised world to it; where another program placed it, it may be any affine matrix.
    metres_per_unit : float or None
        Metres in one unit of the file: 1 when the file is in metres, None when the unit is unknown.
    scale_residual : float or None
        See `Measurement.scale_residual`.
    """

    name: str
    from_world: Float64
    metres_per_unit: float | None
    scale_residual: float | None = None

    @property
    def is_metric(self) -> bool:
        """Whether one unit of the file is a metre."""
        return self.metres_per_unit == 1.0

    @property
    def unit(self) -> str:
        """``"metre"``, ``"unknown"``, or the length of another unit, such as ``"0.25 metres"``."""
        if self.metres_per_unit is None:
            return "unknown"
        return "metre" if self.is_metric else f"{self.metres_per_unit:.9g} metres"

    def as_dict(self) -> dict[str, Any]:
        """Return what a file says of its frame, as JSON values: ``frame``, ``unit``, ``metres_per_unit`` (or null).

        ``scale_residual_metres`` is added when several distances were measured.
        """
        facts: dict[str, Any] = {"frame": self.name, "unit": self.unit, "metres_per_unit": self.metres_per_unit}
        return facts if self.scale_residual is None else {**facts, "scale_residual_metres": self.scale_residual}

    def as_comments(self) -> list[str]:
        """Return `as_dict` as header comments of a PLY file, without what is unknown but for the unit itself."""
        facts = {key: value for key, value in self.as_dict().items() if value is not None}
        return [f"{key} {value:.9g}" if isinstance(value, float) else f"{key} {value}" for key, value in facts.items()]


def export_frame(camera_set: CameraSet, measurement: Measurement, name: str | None = None) -> ExportFrame:
    """Return the frame of an exported file.

    Parameters
    ----------
    measurement : Measurement
        Of the same project.
    name : {"upright", "original"}, optional
        ``"original"`` is the frame of the given or estimated poses; its unit is not changed. ``"upright"`` is the
        measured frame where something was measured, otherwise the normalised world. By default original where poses
        were given and nothing was measured, otherwise upright.
    """
    original = camera_set.poses_given and measurement.is_empty if name is None else name == "original"
    scale, residual = measurement.metres_per_unit, measurement.scale_residual
    if original:
        to_original = camera_set.original_from_world
        size = similarity_scale(to_original)
        return ExportFrame("original", to_original, None if scale is None else scale / size, residual)
    frame = "upright" if measurement.is_empty else "measured"
    return ExportFrame(frame, measurement.measured_from_world, None if scale is None else 1.0, residual)
