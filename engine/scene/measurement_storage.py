"""The file of a `Measurement`: ``measurement.json`` in the project folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..core.errors import FormatError, SettingsError
from ..core.files import delete_derived, file_sha256, optional, path_within, read_versioned, write_json
from .measurement import MeasuredDistance, Measurement, Point, measurement_problem

_VERSION = 1
_FILE = "measurement.json"
_POINT = [float]
_SCHEMA = {
    "cameras": str,
    "distances": [{"first": _POINT, "second": _POINT, "metres": float}],
    "ground": [_POINT],
    "north": optional(([_POINT], None)),
    "origin": optional((_POINT, None)),
}
_ADVICE = "Delete it with `measure PROJECT --clear`, then measure again."


def save_measurement(project: Path, measurement: Measurement) -> None:
    """Write `measurement` to the project folder `project` atomically; an empty one deletes the file.

    Raises
    ------
    SettingsError
        When it cannot be used, see `measurement_problem`.
    FormatError
        When the project has no cameras.
    DiskError
        When the file cannot be written.
    """
    if problem := measurement_problem(measurement):
        raise SettingsError(f"The measurement cannot be used: {problem}. Pick the points again.")
    if measurement.is_empty:
        delete_measurement(project)
        return
    write_json(
        path_within(project, _FILE),
        {
            "version": _VERSION,
            "convention": "points in the normalised world of the cameras; distances in metres",
            "cameras": _cameras_hash(project),
            "distances": [
                {"first": list(distance.first), "second": list(distance.second), "metres": distance.metres}
                for distance in measurement.distances
            ],
            "ground": [list(point) for point in measurement.ground],
            "north": None if measurement.north is None else [list(point) for point in measurement.north],
            "origin": None if measurement.origin is None else list(measurement.origin),
        },
    )


def load_measurement(project: Path) -> Measurement:
    """Return the measurement of the project folder `project`, an empty one when nothing was measured.

    Raises
    ------
    FormatError
        When the file is damaged or cannot be used, or was measured with other cameras: points of an earlier
        reconstruction are at other places of the present one.
    """
    file = path_within(project, _FILE)
    if not file.exists():
        return Measurement()
    data = read_versioned(file, _SCHEMA, version=_VERSION, advice=_ADVICE)
    try:
        north = data.get("north")
        if north is not None and len(north) != 2:
            raise ValueError("`north` must have 2 points")
        origin = data.get("origin")
        measurement = Measurement(
            distances=tuple(
                MeasuredDistance(_point(entry["first"]), _point(entry["second"]), float(entry["metres"]))
                for entry in data["distances"]
            ),
            ground=tuple(map(_point, data["ground"])),
            north=None if north is None else (_point(north[0]), _point(north[1])),
            origin=None if origin is None else _point(origin),
        )
        if problem := measurement_problem(measurement):
            raise ValueError(problem)
    except ValueError as error:
        raise FormatError(f"{file} cannot be read: {error}. {_ADVICE}") from error
    if data["cameras"] != _cameras_hash(project):
        raise FormatError(f"{file} was measured in an earlier reconstruction of this scene. {_ADVICE}")
    return measurement


def delete_measurement(project: Path) -> None:
    """Delete the measurement of the project folder `project`, if it has one.

    Raises
    ------
    DiskError
        When it cannot be deleted.
    """
    if path_within(project, _FILE).exists():
        delete_derived(project, _FILE)


def _point(values: list[Any]) -> Point:
    if len(values) != 3:
        raise ValueError(f"a point has {len(values)} numbers, not 3")
    x, y, z = map(float, values)
    return x, y, z


def _cameras_hash(project: Path) -> str:
    """Return the SHA-256 of the project's cameras, whose frame the points are in."""
    file = path_within(project, "cameras", "cameras.json")
    if not file.is_file():
        raise FormatError(f"{file} is missing. Run `reconstruct` first.")
    return file_sha256(file)
