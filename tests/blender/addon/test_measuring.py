"""A measured project stands in Blender in metres, level, and is exported so; an unmeasured one has no unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part


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
    assert bpy.ops.heritage.export_objects(directory=str(folder), format="PLY", scope=scope, overwrite=True) == {
        "FINISHED"
    }
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
    shown = np.array(vase.matrix_basis, np.float64)  # Blender does not evaluate it while the scene is shown
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


PHOTO = "a b/view 1.jpg"


@pytest.fixture
def floor(project: Any, part: Part, camera: Any) -> Any:
    """A project whose scene is an opaque floor at height -0.5, opened."""
    x, y = np.meshgrid(np.linspace(-1, 1, 10), np.linspace(-1, 1, 10))
    gaussians = project.gaussians
    gaussians.means[:] = np.column_stack([x.ravel(), y.ravel(), np.full(100, -0.5)])
    gaussians.log_scales[:], gaussians.opacity_logits[:] = np.log([0.2, 0.2, 0.001]), 5.0
    gaussians.quats[:] = (1, 0, 0, 0)
    part("engine.formats").write_ply(project.folder / "gaussians" / "scene.ply", gaussians)
    open_project(project)
    return project


def pixels(camera: Any, *points: tuple[float, float, float]) -> list[dict[str, Any]]:
    fx, fy, cx, cy = camera.params
    found = []
    for point in points:
        x, y, z = camera.viewmat[:3, :3] @ point + camera.viewmat[:3, 3]
        found.append({"name": "", "photo": PHOTO, "x": fx * x / z + cx, "y": fy * y / z + cy, "wanted": True})
    return found


def test_points_give_scale_ground_north_and_origin_and_the_panel_shows_them(
    floor: Any, part: Part, camera: Any, draw: Callable[[str], Any]
) -> None:
    scene = bpy.context.scene
    assert any("unit is unknown" in text for text in draw("HERITAGE_PT_measure").texts)
    a, b, c = (0.0, 0.0, -0.5), (0.5, 0.0, -0.5), (0.0, 0.5, -0.5)
    scene.heritage.show = "OBJECTS"  # a photo shows the floor nevertheless
    assert bpy.ops.heritage.measure(action="DISTANCE", metres=1.0, points_on_photos=pixels(camera, a, b)) == {
        "FINISHED"
    }
    # Gaussians with a thickness of 0.001.
    assert load(part, floor).metres_per_unit == pytest.approx(2.0, rel=0.01)
    assert scene.unit_settings.system == "METRIC"
    bpy.context.view_layer.update()
    bpy.ops.heritage.measure(action="DISTANCE", metres=1.04, points_on_photos=pixels(camera, a, c))
    measured = load(part, floor)
    assert measured.metres_per_unit == pytest.approx(2.04, rel=0.01)
    assert measured.scale_residual == pytest.approx(0.02, abs=0.005)
    bpy.context.view_layer.update()
    bpy.ops.heritage.measure(action="GROUND", points_on_photos=pixels(camera, a, b, c))
    bpy.context.view_layer.update()
    bpy.ops.heritage.measure(action="NORTH", points_on_photos=pixels(camera, a, b))
    bpy.context.view_layer.update()
    bpy.ops.heritage.measure(action="ORIGIN", points_on_photos=pixels(camera, b))
    bpy.context.view_layer.update()
    whole = next(obj for obj in scene.objects if obj.heritage.role == "SCENE")
    matrix = np.array(whole.matrix_world)
    np.testing.assert_allclose(by(matrix, np.array([b]))[0], [0, 0, 0], atol=0.02)
    np.testing.assert_allclose(by(matrix, np.array([a]))[0], [0, -1.02, 0], atol=0.02)
    assert bpy.ops.heritage.measure(action="RULER", points_on_photos=pixels(camera, a, b)) == {"FINISHED"}
    texts = draw("HERITAGE_PT_measure").texts
    assert any("agree within" in text for text in texts) and any(text.startswith("1.0") for text in texts)
    assert bpy.ops.heritage.clear_measurement(distance=2) == {"FINISHED"}
    assert len(load(part, floor).distances) == 1
    assert bpy.ops.heritage.clear_measurement() == {"FINISHED"}
    bpy.context.view_layer.update()
    np.testing.assert_allclose(np.array(whole.matrix_world), np.eye(4), atol=1e-5)
    assert any(text.endswith("units") for text in draw("HERITAGE_PT_measure").texts), "the ruler is of the scene"


def load(part: Part, project: Any) -> Any:
    return part("engine.scene").load_measurement(project.folder)


def test_plane_laid_on_the_floor_is_the_ground(floor: Any, part: Part) -> None:
    bpy.ops.object.empty_add(location=(0, 0, -0.5), rotation=(0.2, 0, 0))
    bpy.context.view_layer.update()
    assert bpy.ops.heritage.ground_from_plane() == {"FINISHED"}
    np.testing.assert_allclose(load(part, floor).up, [0, -np.sin(0.2), np.cos(0.2)], atol=1e-6)
    bpy.context.view_layer.objects.active = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    with pytest.raises(RuntimeError, match="not the splats"):
        bpy.ops.heritage.ground_from_plane()


def test_plane_goes_on_lying_on_the_floor(floor: Any, part: Part, camera: Any) -> None:
    points = np.array([(0.0, 0.0, -0.5), (0.5, 0.0, -0.5), (0.0, 0.5, -0.5)])
    bpy.ops.mesh.primitive_plane_add(location=(0, 0, -0.5), rotation=(0.2, 0, 0))
    plane = bpy.context.view_layer.objects.active
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    bpy.context.view_layer.update()
    before = np.linalg.solve(np.array(whole.matrix_world), np.array(plane.matrix_world))
    ground = []
    for _ in range(2):  # Used again, it changes nothing.
        bpy.context.view_layer.objects.active = plane
        assert bpy.ops.heritage.ground_from_plane() == {"FINISHED"}
        bpy.context.view_layer.update()
        assert abs(plane.matrix_world.translation.z) < 1e-5  # float32
        np.testing.assert_allclose(np.array(plane.matrix_world)[:3, 2], [0, 0, 1], atol=1e-5)
        ground.append(load(part, floor).ground)
    np.testing.assert_allclose(*ground, atol=1e-5)
    # Also when it is measured otherwise later, and when all of it is removed.
    bpy.ops.heritage.measure(action="DISTANCE", metres=3.0, points_on_photos=pixels(camera, *points[:2]))
    for _ in range(2):
        bpy.context.view_layer.update()
        now = np.linalg.solve(np.array(whole.matrix_world), np.array(plane.matrix_world))
        np.testing.assert_allclose(now, before, atol=1e-5)
        bpy.ops.heritage.clear_measurement()


def test_what_cannot_be_measured_is_one_sentence(floor: Any, camera: Any) -> None:
    point = pixels(camera, (0.0, 0.0, -0.5))
    for arguments, words in (
        ({}, "Give points_on_photos"),
        ({"points_on_photos": point}, "2 points are needed"),
        ({"points_on_photos": point * 2}, "both points are the same"),
        ({"action": "GROUND", "points_on_photos": point}, "at least 3 points"),
        ({"points_on_photos": [{**point[0], "x": 1.0, "y": 1.0}] * 2}, "no surface"),
    ):
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.heritage.measure(**arguments)
    with pytest.raises(RuntimeError, match="no distance 3"):
        bpy.ops.heritage.clear_measurement(distance=3)


def test_measurement_of_other_cameras_is_told_and_can_be_cleared(
    floor: Any, part: Part, camera: Any, draw: Callable[[str], Any]
) -> None:
    measure(part, floor)
    file = floor.folder / "cameras" / "cameras.json"
    file.write_text(file.read_text(encoding="utf-8") + " ", encoding="utf-8")
    # The sentence begins with a path, whose length decides where its lines are broken.
    assert "earlier reconstruction" in " ".join(draw("HERITAGE_PT_measure").texts)
    bpy.ops.heritage.clear_measurement()
    assert load(part, floor).is_empty


def undo_to(part: Part, mark: str | None) -> None:
    """Do what Ctrl+Z does here. Blender as a Python module does not end after a real undo."""
    scene = bpy.context.scene
    if mark is None:
        scene.pop("heritage_measured", None)
    else:
        scene["heritage_measured"] = mark
    for handler in bpy.app.handlers.undo_post:
        handler(scene, None)


def test_undo_takes_a_measurement_back_in_the_project_too_and_redo_brings_it_again(
    floor: Any, part: Part, camera: Any
) -> None:
    ends = pixels(camera, (0.0, 0.0, -0.5), (0.5, 0.0, -0.5))
    bpy.ops.heritage.measure(action="DISTANCE", metres=1.0, points_on_photos=ends)
    bpy.context.view_layer.update()
    first = load(part, floor), bpy.context.scene["heritage_measured"]
    bpy.ops.heritage.measure(action="DISTANCE", metres=2.0, points_on_photos=ends)
    second = load(part, floor), bpy.context.scene["heritage_measured"]
    assert [len(one.distances) for one, _ in (first, second)] == [1, 2]
    for (measurement, mark), n_distances in ((first, 1), (second, 2), (first, 1)):
        undo_to(part, mark)
        assert load(part, floor) == measurement and len(measurement.distances) == n_distances
    undo_to(part, None)
    assert load(part, floor).is_empty
    # Undo of anything else.
    undo_to(part, None)
    assert load(part, floor).is_empty


def test_undo_keeps_what_another_program_has_measured_since_and_says_so(floor: Any, part: Part, camera: Any) -> None:
    ends = pixels(camera, (0.0, 0.0, -0.5), (0.5, 0.0, -0.5))
    bpy.ops.heritage.measure(action="DISTANCE", metres=1.0, points_on_photos=ends)
    measure(part, floor, 7.0)
    undo_to(part, None)
    assert load(part, floor).distances[0].metres == 7.0
    assert "measured by another program since" in part("gaussian_heritage_addon.blender.problems").shown()


def test_undo_after_a_file_was_loaded_leaves_the_project_alone(
    floor: Any, part: Part, camera: Any, tmp_path: Path
) -> None:
    file = str(tmp_path / "before.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    ends = pixels(camera, (0.0, 0.0, -0.5), (0.5, 0.0, -0.5))
    bpy.ops.heritage.measure(action="DISTANCE", metres=1.0, points_on_photos=ends)
    bpy.ops.wm.open_mainfile(filepath=file)
    undo_to(part, None)
    assert len(load(part, floor).distances) == 1


@pytest.mark.parametrize(
    ("text", "metres"),
    [("30 cm", 0.3), ("30cm", 0.3), ("1.2", 1.2), ("1,2 m", 1.2), ("1m 5cm", 1.05), ("4 ft", 1.2192), ("12mm", 0.012)],
)
@pytest.mark.parametrize("unit_scale", [1.0, 0.01])
def test_known_distance_takes_units_also_before_the_scene_has_one(
    opened: Any, text: str, metres: float, unit_scale: float
) -> None:
    scene = bpy.context.scene
    scene.unit_settings.system, scene.unit_settings.scale_length = "NONE", unit_scale
    scene.heritage.known_distance_text = text
    assert scene.heritage.known_distance == pytest.approx(metres, rel=1e-6)
    shown = scene.heritage.known_distance_text
    scene.heritage.known_distance_text = shown
    assert scene.heritage.known_distance == pytest.approx(metres, rel=1e-4)


@pytest.mark.parametrize("text", ["", "vase", "0", "-3 cm", "30 kg", "nan"])
def test_what_is_no_length_is_told_with_examples(opened: Any, part: Part, text: str) -> None:
    errors, before = part("engine.core.errors"), bpy.context.scene.heritage.known_distance
    with pytest.raises(errors.SettingsError, match="Enter for example 30 cm"):
        part("gaussian_heritage_addon.blender.lengths").read_length(text)
    assert bpy.context.scene.heritage.known_distance == before


def test_view_follows_a_scene_that_is_measured(opened: Any, part: Part) -> None:
    """What was in the middle of the view stays there, as large as before, and upright."""
    from mathutils import Matrix, Quaternion, Vector

    move = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.7, 4, (1, 1, 0)) @ Matrix.Scale(2.5, 4)
    turn = Quaternion((0.2, 0.5, 0.1), 1.1)
    view = SimpleNamespace(view_location=Vector((0.5, 0.1, 0.2)), view_distance=4.0, view_rotation=turn)
    eye = view.view_location + view.view_rotation @ Vector((0, 0, 4.0))
    part("gaussian_heritage_addon.project.moved_views").move_view(view, np.array(move))
    new_eye = view.view_location + view.view_rotation @ Vector((0, 0, view.view_distance))
    assert view.view_distance == pytest.approx(10.0)
    np.testing.assert_allclose(new_eye, move @ eye, atol=1e-5)
    right = view.view_rotation @ Vector((1, 0, 0))
    assert abs(right.z) < 1e-5


def test_measuring_moves_the_views_as_the_splats(opened: Any, part: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    module, moves = part("gaussian_heritage_addon.project.measuring"), []
    monkeypatch.setattr(module, "follow_move", lambda scene, move: moves.append(move))
    scene, types = bpy.context.scene, part("engine.scene")
    distance = types.MeasuredDistance((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 5.0)
    for measurement in (types.Measurement((distance,)), types.Measurement()):
        module.measure(scene, measurement)
    np.testing.assert_allclose(np.cbrt(np.linalg.det(moves[0][:3, :3])), 5.0, rtol=1e-5)
    np.testing.assert_allclose(moves[1] @ moves[0], np.eye(4), atol=1e-5)


def test_visible_rulers_before_the_eye_are_drawn_over_the_splats(blender: ModuleType, part: Part) -> None:
    measuring, view = (
        part("gaussian_heritage_addon.project.measuring"),
        part("gaussian_heritage_addon.project.ruler_view"),
    )
    # Looks along y, without perspective: x and z from -1 to 1 fill the picture.
    window = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], np.float64)
    sight = part("gaussian_heritage_addon.splats.sight").Sight(200, 100, window)
    scene = bpy.context.scene
    ruler = measuring.add_ruler(scene, np.array([0.0, 0.3, 0.0]), np.array([0.5, 0.3, 0.5]))
    ((name, ends),) = view.rulers_in_view(bpy.context, sight)
    assert name == ruler.name
    np.testing.assert_allclose(ends, [(100, 50), (150, 75)], atol=1e-4)
    behind = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, -1, 0, 0]], np.float64)
    assert view.rulers_in_view(bpy.context, replace(sight, window_from_world=behind)) == []
    ruler.hide_set(True)
    assert view.rulers_in_view(bpy.context, sight) == []
