"""`measure`: points on photos give the scale and the ground; what cannot be is one sentence and changes nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.project.folder import ProjectFolder
from engine.scene import load_measurement
from tests.engine.command_line import Answer, call
from tests.engine.pictures.blob_scene import RED, TWIN, BlobScene


def measure(capsys: pytest.CaptureFixture[str], scene: Path, *words: object) -> Answer:
    return call(capsys, "measure", scene, *words)


def outputs(answer: Answer) -> dict[str, object]:
    assert answer.code == 0
    (finished,) = answer.of_kind("finished")
    found: dict[str, object] = finished["outputs"]
    return found


def point(blobs: BlobScene, part: int, photo: str) -> str:
    x, y = blobs.center_of(part, photo)
    return f"{photo}={x + 0.5:g},{y + 0.5:g}"


def test_distance_between_two_points_of_a_photo_scales_the_scene(
    scene: Path, blobs: BlobScene, capsys: pytest.CaptureFixture[str]
) -> None:
    assert outputs(measure(capsys, scene))["metres_per_unit"] is None
    red, twin = point(blobs, RED, "view_0.png"), point(blobs, TWIN, "view_0.png")
    found = outputs(measure(capsys, scene, "--distance", red, twin, 0.26, "--between", red, twin))
    # The balls are 1.3 units apart; the picked points lie on their fronts, up to a radius of 0.28 nearer.
    assert found["metres_per_unit"] == pytest.approx(0.2, rel=0.1)
    assert found["between"] == pytest.approx([0.26]) and found["between_unit"] == "metre"
    assert load_measurement(scene).metres_per_unit == found["metres_per_unit"]
    again = outputs(measure(capsys, scene, "--distance", "xyz=0,0,0", "xyz=-1,0,0", 0.21))
    assert len(again["residuals_metres"]) == 2  # type: ignore[arg-type]
    assert again["scale_residual_metres"] is not None
    found = outputs(measure(capsys, scene, "--remove", 1))
    assert found["metres_per_unit"] == pytest.approx(0.21)
    assert outputs(measure(capsys, scene, "--clear"))["metres_per_unit"] is None


def test_ground_north_and_origin_are_picked(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Points of the floor, which is at -0.33, near the lower edge of three photos.
    floor = [f"view_{number}.png=80,112" for number in (0, 3, 5, 6)]
    measure(capsys, scene, "--ground", *floor, "--north", "xyz=0,0,0", "xyz=1,1,0", "--origin", "xyz=0.5,0.5,0")
    measurement = load_measurement(scene)
    matrix = measurement.measured_from_world
    # The Gaussians of the floor are 0.01 thick.
    assert (matrix @ (0, 0, -0.33, 1))[2] == pytest.approx(-0.33, abs=0.02)
    assert measurement.up[2] > 0.999
    north = matrix[:3, :3] @ np.array([1, 1, 0]) / np.sqrt(2)
    assert north == pytest.approx([0, 1, 0], abs=0.03)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--distance", "xyz=1,1,0", "xyz=0,0,0", "far"), "number of metres"),
        (("--distance", "xyz=0,0,0", "xyz=1,0,0", "-1"), "above 0"),
        (("--between", "view_99.png=1,1", "xyz=0,0,0"), "no photo 'view_99.png'"),
        (("--between", "view_0.png", "xyz=0,0,0"), "is no point"),
        (("--between", "view_0.png=900,1", "xyz=0,0,0"), "outside of view_0.png"),
        (("--between", "view_0.png=1,1", "xyz=0,0,0"), "shows no surface"),
        (("--ground", "xyz=0,0,0", "xyz=1,0,0"), "at least 3 points"),
        (("--remove", "1"), "no distance 1"),
    ],
)
def test_what_cannot_be_measured_is_one_sentence(
    words: tuple[str, ...], sentence: str, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in measure(capsys, scene, *words).error
    assert not (scene / "measurement.json").exists()


def test_project_that_another_job_uses_is_not_changed(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with ProjectFolder.open_existing(scene):
        answer = measure(capsys, scene, "--origin", "xyz=0,0,0")
    assert "Another job is working" in answer.error and load_measurement(scene).is_empty
