"""The panel's picture of the training curve shows the measured points."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from .conftest import PACKAGE

curve = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.project.curve")
MEASURED = [(0.8, 20.9), (3.0, 23.0), (12.0, 25.5), (50.0, 27.6), (195.0, 28.7)]


def on_the_line(picture: np.ndarray) -> np.ndarray:
    """Return a mask of the pixels with the colour of the line."""
    return (picture[..., 3] > 0.9) & (np.abs(picture[..., :3] - curve._LINE).max(axis=-1) < 0.05)


def test_line_goes_from_the_first_point_at_the_bottom_to_the_last_at_the_top() -> None:
    picture = curve.curve_picture(MEASURED)
    assert picture.shape == (160, 256, 4) and picture.dtype == np.float32
    assert np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1
    rows, columns = np.nonzero(on_the_line(picture))
    assert rows[columns.argmin()] == pytest.approx(curve._BOTTOM, abs=3)
    assert rows[columns.argmax()] == pytest.approx(160 - curve._BORDER, abs=3)
    heights = [rows[columns == column].mean() for column in range(columns.min(), columns.max() + 1)]
    assert np.all(np.diff(heights) > -0.6)


def test_time_is_logarithmic() -> None:
    """A point at the geometric mean of the times is in the middle."""
    rows, columns = np.nonzero(on_the_line(curve.curve_picture([(1.0, 20.0), (10.0, 30.0), (100.0, 20.0)])))
    middle = columns[rows == rows.max()].mean()
    assert middle == pytest.approx((curve._LEFT + 256 - curve._BORDER) / 2, abs=2)


def test_axis_numbers_are_round_values() -> None:
    assert list(curve._round_seconds(0.8, 195.0)) == [1, 2, 5, 10, 20, 50, 100]
    assert list(curve._round_seconds(0.8, 2500.0)) == [1, 10, 100, 1000]
    assert list(curve._round_values(20.9, 28.7)) == [22, 24, 26, 28]


@pytest.mark.parametrize("points", [[], [(1.0, 20.0)], [(0.0, 1.0), (np.nan, 2.0), (5.0, 3.0)], [(2.0, 1.0)] * 2])
def test_fewer_than_two_points_give_no_picture(points: list[tuple[float, float]]) -> None:
    assert curve.curve_picture(points) is None


@pytest.mark.parametrize("points", [[(1e-4, 5.0), (1e6, 5.0)], [(1.0, -300.0), (2.0, 900.0)], [(0.01, 3), (0.02, 4)]])
def test_extreme_curves_are_drawn(points: list[tuple[float, float]]) -> None:
    assert on_the_line(curve.curve_picture(points)).any()


def write_curve(project: Path, points: list[dict[str, float | None]]) -> None:
    """Write a project whose training is finished."""
    training = {"key": "k", "wall_seconds": 2.0, "cpu_seconds": 2.0, "figures": {"curve": points}, "outputs": {}}
    stored = {"version": 1, "stages": {"training": training}, "earlier_outputs": {}}
    (project / "project.json").write_text(json.dumps(stored))


def test_curve_of_a_finished_training_is_read_and_updated(tmp_path: Path) -> None:
    assert curve.stored_curve(tmp_path) == ()

    def write(psnr: float) -> None:
        write_curve(tmp_path, [{"step": 1, "wall_seconds": 2.0, "psnr": psnr}])

    write(20.0)
    assert curve.stored_curve(tmp_path) == ((2.0, 20.0),)
    write(21.25)
    assert curve.stored_curve(tmp_path) == ((2.0, 21.25),)
    (tmp_path / "project.json").write_text("{")
    assert curve.stored_curve(tmp_path) == ()


def test_long_curve_is_thinned_and_its_end_kept(tmp_path: Path) -> None:
    points = [{"step": n, "wall_seconds": float(n + 1), "psnr": 20.0 + n / 1e4} for n in range(20_000)]
    write_curve(tmp_path, [*points, {"step": 0, "wall_seconds": 3e4, "psnr": None}])
    stored = curve.stored_curve(tmp_path)
    assert len(stored) == 256 and stored[-1] == (20_000.0, points[-1]["psnr"])


@pytest.mark.parametrize("points", [[(1.0, 1e300), (2.0, -1e300)], [(1e-300, 1.0), (1e300, 2.0)]])
def test_values_that_no_training_has_are_not_drawn(points: list[tuple[float, float]]) -> None:
    assert curve.curve_picture(points) is None


@pytest.mark.parametrize("curve_value", [5, {"a": 1}, [1], [{"psnr": 1}], [{"psnr": "x", "wall_seconds": []}], None])
def test_damaged_curve_is_not_shown(tmp_path: Path, curve_value: object) -> None:
    write_curve(tmp_path, curve_value)  # type: ignore[arg-type]
    assert curve.stored_curve(tmp_path) == ()
