"""Scale, ground, north and origin of a scene: fitted, checked, stored, and used in exports."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.errors import FormatError, SettingsError
from engine.scene import (
    CameraSet,
    MeasuredDistance,
    Measurement,
    Point,
    delete_measurement,
    export_frame,
    load_measurement,
    measurement_problem,
    save_measurement,
)

A, B, C = (0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 4.0, 0.0)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "cameras").mkdir()
    (tmp_path / "cameras" / "cameras.json").write_text("{}")
    return tmp_path


def camera_set(*, given: bool) -> CameraSet:
    original = np.diag([10.0, 10.0, 10.0, 1.0])
    return CameraSet((), (), np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), math.nan, original, given)


def moved(measurement: Measurement, point: Point) -> list[float]:
    return list(np.round((measurement.measured_from_world @ (*point, 1.0))[:3], 9) + 0.0)


def test_one_distance_gives_the_scale_and_no_residual() -> None:
    measurement = Measurement(distances=(MeasuredDistance(A, B, 0.5),))
    assert measurement.metres_per_unit == pytest.approx(0.25)
    assert measurement.residuals == pytest.approx((0.0,))
    assert measurement.scale_residual is None
    assert moved(measurement, B) == [0.5, 0.0, 0.0]


def test_several_distances_are_fitted_and_their_differences_told() -> None:
    # 2 and 4 units, 1.1 and 1.9 m: the fit of least squares is (2 * 1.1 + 4 * 1.9) / (4 + 16) = 0.49.
    measurement = Measurement(distances=(MeasuredDistance(A, B, 1.1), MeasuredDistance(A, C, 1.9)))
    assert measurement.metres_per_unit == pytest.approx(0.49)
    assert measurement.residuals == pytest.approx((-0.12, 0.06))
    assert measurement.scale_residual == pytest.approx(math.sqrt((0.12**2 + 0.06**2) / 2))


def test_scale_of_tiny_and_huge_scenes_is_finite() -> None:
    for size in (1e-8, 1e14):
        distances = (MeasuredDistance(A, (size, 0, 0), 1.0), MeasuredDistance(A, (0, size, 0), 1.0))
        assert Measurement(distances=distances).metres_per_unit == pytest.approx(1 / size)


def test_ground_becomes_level_at_height_zero_with_north_along_y() -> None:
    rng = np.random.default_rng(5)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation[:, 2] *= np.sign(rotation[2, 2])  # its up direction is nearer to Z than to -Z
    rotation[:, 0] *= np.linalg.det(rotation)
    offset = np.array([0.3, -0.2, 0.9])
    flat = [(1, 2, 0), (-3, 1, 0), (2, -2, 0), (0, 5, 0)]
    ground: tuple[Point, ...] = tuple(tuple(rotation @ point + offset) for point in flat)  # type: ignore[misc]
    start, end = (tuple(rotation @ np.array(point) + offset) for point in ((0, 0, 1), (3, 4, 2)))
    measurement = Measurement(ground=ground, north=(start, end))  # type: ignore[arg-type]
    assert measurement.ground_residual == pytest.approx(0.0, abs=1e-12)
    assert [moved(measurement, point)[2] for point in ground] == pytest.approx([0.0] * 4, abs=1e-9)
    north = np.subtract(moved(measurement, end), moved(measurement, start))  # type: ignore[arg-type]
    assert north == pytest.approx([0.0, 5.0, 1.0])
    assert np.linalg.det(measurement.measured_from_world[:3, :3]) == pytest.approx(1.0)


def test_ground_alone_keeps_heading_and_the_origin_comes_down_to_it() -> None:
    measurement = Measurement(ground=((0, 0, -1), (1, 0, -1), (0, 1, -1)))
    assert moved(measurement, (0, 0, -1)) == [0, 0, 0]
    assert moved(measurement, (2, 3, 0)) == [2, 3, 1]


def test_ground_across_the_y_axis_still_gives_a_rotation() -> None:
    measurement = Measurement(ground=((0, 0, 0), (1, 0, 0), (0, 0, 1)))
    linear = measurement.measured_from_world[:3, :3]
    assert np.allclose(linear @ linear.T, np.eye(3)) and np.linalg.det(linear) == pytest.approx(1.0)


def test_picked_origin_is_the_origin_also_with_a_scale() -> None:
    measurement = Measurement(distances=(MeasuredDistance(A, B, 6.0),), origin=(1.0, 2.0, 3.0))
    assert moved(measurement, (1.0, 2.0, 3.0)) == [0, 0, 0]
    assert moved(measurement, (1.0, 2.0, 4.0)) == [0, 0, 3]


@pytest.mark.parametrize(
    ("measurement", "words"),
    [
        (Measurement(distances=(MeasuredDistance(A, A, 1.0),)), "both points are the same"),
        (Measurement(distances=(MeasuredDistance(A, B, 0.0),)), "must be above 0"),
        (Measurement(distances=(MeasuredDistance(A, B, math.nan),)), "must be above 0"),
        (Measurement(distances=(MeasuredDistance(A, (math.inf, 0, 0), 1.0),)), "not finite"),
        (Measurement(ground=(A, B)), "at least 3 points, got 2"),
        (Measurement(ground=(A, B, (1.0, 0.001, 0.0))), "lie on a line"),
        (Measurement(ground=(A, A, A)), "lie on a line"),
        (Measurement(ground=(A, B, (math.nan, 0, 0))), "not finite"),
        (Measurement(north=(A, A)), "both points are the same"),
        (Measurement(north=(A, (0.0, 0.0, 1.0))), "lie above one another"),
        (Measurement(origin=(1e16, 0.0, 0.0)), "the origin"),
    ],
)
def test_what_cannot_be_a_measurement_is_refused_and_not_written(
    measurement: Measurement, words: str, project: Path
) -> None:
    assert words in str(measurement_problem(measurement))
    with pytest.raises(SettingsError, match=words):
        save_measurement(project, measurement)
    assert not (project / "measurement.json").exists()


def test_stored_measurement_is_read_back_and_an_empty_one_removes_the_file(project: Path) -> None:
    assert load_measurement(project).is_empty
    measurement = Measurement(
        (MeasuredDistance(A, B, 0.3),), ground=(A, B, C), north=(A, (0.1, 1.0, 0.0)), origin=(0.1, 0.2, 0.3)
    )
    save_measurement(project, measurement)
    assert load_measurement(project) == measurement
    save_measurement(project, Measurement())
    assert not (project / "measurement.json").exists()
    delete_measurement(project)


def test_measurement_of_an_earlier_reconstruction_is_refused(project: Path) -> None:
    save_measurement(project, Measurement(origin=A))
    (project / "cameras" / "cameras.json").write_text("{ }")
    with pytest.raises(FormatError, match="an earlier reconstruction"):
        load_measurement(project)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("north", [[0, 0, 0]], "`north` must have 2 points"),
        ("origin", [0, 0], "a point has 2 numbers"),
        ("ground", [[0, 0, 0]], "at least 3 points"),
        ("distances", [{"first": [0, 0, 0], "second": [1, 0, 0]}], "metres"),
    ],
)
def test_damaged_file_is_one_sentence(name: str, value: Any, words: str, project: Path) -> None:
    save_measurement(project, Measurement(origin=A))
    file = project / "measurement.json"
    file.write_text(json.dumps({**json.loads(file.read_text(encoding="utf-8")), name: value}))
    with pytest.raises(FormatError, match=words):
        load_measurement(project)


def test_frame_of_a_file_says_its_unit_or_that_it_is_unknown() -> None:
    nothing, distance = Measurement(), Measurement((MeasuredDistance(A, B, 1.0),))
    estimated, given = camera_set(given=False), camera_set(given=True)
    assert export_frame(estimated, nothing).as_dict() == {
        "frame": "upright",
        "unit": "unknown",
        "metres_per_unit": None,
    }
    assert export_frame(given, nothing).name == "original"
    assert export_frame(given, distance).as_dict() == {"frame": "measured", "unit": "metre", "metres_per_unit": 1.0}
    original = export_frame(estimated, distance, "original")
    assert (original.name, original.unit) == ("original", "0.05 metres")
    assert original.as_comments() == ["frame original", "unit 0.05 metres", "metres_per_unit 0.05"]
    assert export_frame(estimated, Measurement(origin=B)).unit == "unknown"
    two = Measurement((MeasuredDistance(A, B, 1.0), MeasuredDistance(A, C, 2.2)))
    assert export_frame(estimated, two).as_dict()["scale_residual_metres"] == pytest.approx(two.scale_residual)
