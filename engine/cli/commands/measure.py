"""``measure``: gives a scene its scale, ground, north and origin by points picked on photos, and measures distances."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import PromptError, SettingsError
from ...core.events import Emit, Finished, StopCheck
from ...project.folder import ProjectFolder
from .named_photos import known_photo

if TYPE_CHECKING:
    from ...scene import Measurement, Point

NAME = "measure"
HELP = "Give a scene its scale, ground, north and origin by points picked on photos, and measure distances."
EXAMPLE = "python -m engine measure scene --distance IMG_1.jpg=364,500 IMG_1.jpg=364,700 0.42"
LOG_IN = "project"

_WORLD = "xyz"
"""Takes the place of a photo's name in a position in the normalised world."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    points = parser.add_argument_group(
        "points",
        "POINT is PHOTO=x,y, a pixel of a photo from its top left corner, where the surface that the photo shows is "
        f"picked; or {_WORLD}=X,Y,Z, a position in the scene as it was reconstructed. Without an option, what was "
        "measured is printed.",
    )
    points.add_argument(
        "--distance", nargs=3, action="append", default=[], metavar=("POINT", "POINT", "METRES"),
        help="a known distance; several give the scale by least squares, and how well they agree",
    )  # fmt: skip
    points.add_argument("--ground", nargs="+", metavar="POINT", help="three or more points of the ground")
    points.add_argument("--north", nargs=2, metavar=("FROM", "TO"), help="two points, the second to the north")
    points.add_argument("--origin", metavar="POINT", help="the origin of exported files")
    points.add_argument(
        "--between", nargs=2, action="append", default=[], metavar=("POINT", "POINT"), help="print this distance"
    )
    parser.add_argument(
        "--remove", type=int, action="append", default=[], metavar="N", help="remove distance N of the printed list"
    )
    parser.add_argument("--clear", action="store_true", help="first remove all that was measured")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Store the measurements, and print them."""
    from ...scene import Measurement, delete_measurement, load_measurement, save_measurement

    with ProjectFolder.open_existing(options.project) as project:
        project.require_intact("cameras", "training")
        if options.clear:
            delete_measurement(project.path)
        before = Measurement() if options.clear else load_measurement(project.path)
        pick = _picker(project.path)
        after = _changed(before, options, pick)
        pairs = [(pick(first), pick(second)) for first, second in options.between]
        if after != before:
            save_measurement(project.path, after)
    message, outputs = _report(after, pairs)
    emit(Finished(message, outputs))
    return 0


def _changed(before: Measurement, options: argparse.Namespace, pick: Callable[[str], Point]) -> Measurement:
    """Return the measurement with the options applied."""
    from ...scene import MeasuredDistance

    if wrong := [number for number in options.remove if not 1 <= number <= len(before.distances)]:
        raise SettingsError(f"There is no distance {wrong[0]} to remove; {len(before.distances)} are stored.")
    kept = [distance for number, distance in enumerate(before.distances, 1) if number not in options.remove]
    new = [MeasuredDistance(pick(first), pick(second), _metres(metres)) for first, second, metres in options.distance]
    after = replace(before, distances=(*kept, *new))
    if options.ground:
        after = replace(after, ground=tuple(map(pick, options.ground)))
    if options.north:
        after = replace(after, north=(pick(options.north[0]), pick(options.north[1])))
    return replace(after, origin=pick(options.origin)) if options.origin else after


def _metres(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise SettingsError(f"A distance is a number of metres, such as 0.42; got {text!r}.") from error


def _picker(project: Path) -> Callable[[str], Point]:
    """Return a function that turns a POINT of the command line into a position; it reads the scene when it has to."""
    from ...scene import RayCaster, read_camera_set, surface_point
    from ...training import load_gaussians

    casters: list[RayCaster] = []

    def pick(text: str) -> Point:
        photo, _, numbers = text.rpartition("=")
        try:
            values = [float(value) for value in numbers.split(",")]
        except ValueError:
            values = []
        if photo == _WORLD and len(values) == 3:
            return values[0], values[1], values[2]
        if not photo or len(values) != 2:
            raise SettingsError(f"{text!r} is no point. Give PHOTO=x,y or {_WORLD}=X,Y,Z.")
        cameras = read_camera_set(project / "cameras").by_photo
        photo = known_photo(photo, cameras)
        if photo not in cameras:
            raise PromptError(f"There is no photo {photo!r} with a camera. Choose one of: {', '.join(cameras)[:500]}.")
        if not casters:
            casters.append(RayCaster(load_gaussians(project / "gaussians")))
        return surface_point(casters[0], cameras[photo], *values)

    return pick


def _report(measurement: Measurement, pairs: list[tuple[Point, Point]]) -> tuple[str, dict[str, Any]]:
    """Return what is measured as lines, and as values for programs."""
    scale = measurement.metres_per_unit
    lines = ["The unit is unknown: give a known distance." if scale is None else f"1 unit is {scale:.6g} metres."]
    for number, (distance, residual) in enumerate(zip(measurement.distances, measurement.residuals, strict=True), 1):
        lines.append(f"Distance {number}: {distance.metres:.6g} m, {residual * 1000:+.1f} mm in the scaled scene.")
    if measurement.scale_residual is not None:
        lines.append(f"The distances agree within {measurement.scale_residual * 1000:.1f} mm (root mean square).")
    if measurement.ground_residual is not None:
        height = _length(measurement.ground_residual, scale)
        # Three points always lie on their plane.
        spread = f", {height} from their plane (root mean square)" if len(measurement.ground) > 3 else ""
        lines.append(f"Ground: {len(measurement.ground)} points{spread}.")
    lines += [f"{name.capitalize()} is set." for name in ("north", "origin") if getattr(measurement, name) is not None]
    lengths = [math.dist(*pair) for pair in pairs]
    lines += [f"Between: {_length(length, scale)}." for length in lengths]
    factor = scale or 1.0
    outputs = {
        "metres_per_unit": scale,
        "residuals_metres": list(measurement.residuals),
        "scale_residual_metres": measurement.scale_residual,
        "ground_residual_units": measurement.ground_residual,
        "measured_from_world": measurement.measured_from_world.tolist(),
        "between": [length * factor for length in lengths],
        "between_unit": "unknown" if scale is None else "metre",
    }
    return "\n".join(lines), outputs


def _length(units: float, scale: float | None) -> str:
    return f"{units:.6g} units" if scale is None else f"{units * scale:.6g} m"
