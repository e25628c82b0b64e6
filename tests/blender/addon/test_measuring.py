"""A measured project stands in Blender in metres, level, and is exported so; an unmeasured one has no unit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest

Part = Callable[[str], ModuleType]


def measure(part: Part, project: Any, metres: float = 3.0) -> np.ndarray:
    """Store a scale of `metres` for one unit, a tilted ground and an origin; return the matrix that they give."""
    scene = part("engine.scene")
    ground = ((0.0, 0.0, 0.1), (1.0, 0.0, 0.2), (0.0, 1.0, 0.3))
    distances = (scene.MeasuredDistance((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), metres),)
    measurement = scene.Measurement(distances, ground=ground, origin=(0.3, 0.1, 0.2))
    scene.save_measurement(project.folder, measurement)
    return np.asarray(measurement.measured_from_world)


def open_project(project: Any) -> bpy.types.Object:
    assert bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    bpy.context.view_layer.update()
    return next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")


def by(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def exported(part: Part, folder: Path, scope: str = "ALL") -> Any:
    assert bpy.ops.heritage.export_objects(directory=str(folder), scope=scope, overwrite=True) == {"FINISHED"}
    (file,) = folder.glob("*.ply")
    return part("engine.formats").read_ply(file), file.read_bytes()


def test_unmeasured_project_has_no_unit_in_the_window_and_in_its_files(
    project: Any, part: Part, tmp_path: Path
) -> None:
    open_project(project)
    assert bpy.context.scene.unit_settings.system == "NONE"
    assert b"comment unit unknown" in exported(part, tmp_path / "out")[1]


def test_measured_project_opens_in_metres_and_level_with_its_cameras(
    project: Any, part: Part, camera: Any, tmp_path: Path
) -> None:
    matrix = measure(part, project)
    scene = open_project(project)
    assert bpy.context.scene.unit_settings.system == "METRIC"
    np.testing.assert_allclose(np.array(scene.matrix_world), matrix, atol=1e-6)
    photo = next(obj for obj in bpy.context.scene.objects if obj.type == "CAMERA" and obj.name.startswith("a b"))
    np.testing.assert_allclose(np.array(photo.matrix_world.translation), by(matrix, camera.center), atol=1e-5)
    np.testing.assert_allclose(np.array(photo.matrix_world.to_scale()), [1, 1, 1], atol=1e-5)
    gaussians, text = exported(part, tmp_path / "out")
    assert b"comment unit metre" in text
    rows = np.linspace(0.2, 1, 40).astype(np.float32) >= 0.5
    np.testing.assert_allclose(gaussians.means, by(matrix, project.gaussians.means[:40][rows]), atol=1e-5)


def test_new_measurement_moves_everything_and_keeps_what_was_moved_by_hand(
    project: Any, part: Part, tmp_path: Path
) -> None:
    before = measure(part, project, 3.0)
    open_project(project)
    vase = bpy.data.objects["Vase"]
    vase.location.x += 0.6
    bpy.context.view_layer.update()
    shown = np.array(vase.matrix_world, np.float64)
    after = measure(part, project, 6.0)
    scene = open_project(project)
    np.testing.assert_allclose(np.array(scene.matrix_world), after, atol=1e-5)
    np.testing.assert_allclose(np.array(vase.matrix_world), after @ np.linalg.inv(before) @ shown, atol=1e-5)
    part("engine.scene").delete_measurement(project.folder)
    scene = open_project(project)
    np.testing.assert_allclose(np.array(scene.matrix_world), np.eye(4), atol=1e-5)
    assert bpy.context.scene.unit_settings.system == "NONE"
    assert b"comment unit unknown" in exported(part, tmp_path / "out")[1]


def test_changed_placement_in_a_file_is_one_sentence(project: Any, part: Part) -> None:
    scene = open_project(project)
    scene["heritage_placement"] = [0.0] * 16
    with pytest.raises(RuntimeError, match="measured placement .* was changed"):
        bpy.ops.heritage.open_project(directory=str(project.folder))
