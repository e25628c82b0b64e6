"""Objects are selected and edited by hand: in the view, in Edit Mode, by scripts; the scene itself stays as it is."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part, write_object

PHOTO = "a b/view 1.jpg"


@pytest.fixture
def balls(project: Any, part: Part, random_gaussians: Callable[..., Any]) -> Any:
    """A project of two opaque balls beside each other, the objects ``left`` and ``right``, and a wall behind them.

    The photo shows the left one at about (50, 44) and the right one at about (86, 44).
    """
    rng = np.random.default_rng(1)
    direction = rng.standard_normal((100, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    wall = np.column_stack([rng.uniform(-3, 3, 400), np.full(400, 2.0), rng.uniform(-3, 3, 400)])
    gaussians = random_gaussians(600, degree=0)
    gaussians.means[:] = np.concatenate([0.2 * direction - (0.3, 0, 0), 0.2 * direction + (0.3, 0, 0), wall])
    gaussians.log_scales[:200], gaussians.log_scales[200:] = np.log(0.06), np.log(0.2)
    gaussians.opacity_logits[:] = 4.0
    part("engine.formats").write_ply(project.folder / "gaussians" / "scene.ply", gaussians)
    label = np.repeat([0, 1, 2], [100, 100, 400])
    for number, name in ((0, "left"), (1, "right"), (2, "vase")):
        write_object(project.folder, name, name.title(), (label == number).astype(np.float32))
    project.gaussians, project.label = gaussians, label
    assert bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    bpy.context.view_layer.update()
    return project


def listed(name: str) -> bpy.types.Object:
    obj = bpy.data.objects[name]
    bpy.context.scene.heritage.active = bpy.data.objects.find(name)
    return obj


def current() -> str:
    return bpy.data.objects[bpy.context.scene.heritage.active].name


def rows_of(part: Part, name: str) -> set[int]:
    return set(part("gaussian_heritage_addon.project.hand_edits").member_rows(bpy.data.objects[name]).tolist())


def pixel(project: Any, camera: Any, point: tuple[float, float, float]) -> tuple[float, float]:
    fx, fy, cx, cy = camera.params
    x, y, z = camera.viewmat[:3, :3] @ point + camera.viewmat[:3, 3]
    return fx * x / z + cx, fy * y / z + cy


def corners(*points: tuple[float, float]) -> list[dict[str, Any]]:
    return [{"name": "", "photo": PHOTO, "x": x, "y": y, "wanted": True} for x, y in points]


def select_in_edit_mode(obj: bpy.types.Object, vertices: np.ndarray) -> None:
    bpy.context.scene.heritage.show = "SCENE" if obj.heritage.role == "SCENE" else "OBJECTS"
    bpy.context.view_layer.objects.active = obj
    chosen = np.zeros(len(obj.data.vertices), bool)
    chosen[vertices] = True
    obj.data.vertices.foreach_set("select", chosen)
    bpy.ops.object.mode_set(mode="EDIT")


@pytest.mark.parametrize("show", ["SCENE", "OBJECTS"])
def test_click_selects_the_object_that_is_seen_also_after_it_was_moved(balls: Any, camera: Any, show: str) -> None:
    bpy.context.scene.heritage.show = show
    for name, center in (("Left", (-0.3, 0, 0)), ("Right", (0.3, 0, 0)), ("Left", (-0.35, -0.1, 0.05))):
        x, y = pixel(balls, camera, center)
        assert bpy.ops.heritage.pick_object(photo=PHOTO, x=x, y=y) == {"FINISHED"}
        assert current() == name
    if show == "OBJECTS":
        bpy.data.objects["Left"].location.z += 5
        bpy.context.view_layer.update()
        x, y = pixel(balls, camera, (-0.3, 0, 0))
        assert bpy.ops.heritage.pick_object(photo=PHOTO, x=x, y=y) == {"FINISHED"}
        assert current() == "Vase", "the wall behind is seen where the ball was"


def test_the_listed_object_stays_when_another_is_made_renamed_or_deleted(balls: Any) -> None:
    obj = listed("Right")
    for name in ("1 cm", "Z"):
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, None))
        assert current() == "Right"
    bpy.data.objects["Left"].name = "Zeus"
    assert current() == "Right"
    bpy.data.objects.remove(bpy.data.objects["1 cm"])
    assert current() == "Right"
    obj.name = "Aphrodite"
    assert current() == "Aphrodite"
    copy = obj.copy()
    bpy.context.scene.collection.objects.link(copy)
    assert listed(copy.name) == copy and current() == copy.name != "Aphrodite"
    bpy.data.objects.remove(copy)
    bpy.data.objects.remove(obj)
    assert bpy.context.scene.heritage.active == -1


def test_click_in_a_measured_scene_hits_the_same(balls: Any, camera: Any, part: Part) -> None:
    scene = part("engine.scene")
    distance = scene.MeasuredDistance((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 4.0)
    scene.save_measurement(balls.folder, scene.Measurement((distance,), origin=(1.0, 2.0, 3.0)))
    bpy.ops.heritage.open_project(directory=str(balls.folder))
    bpy.context.view_layer.update()
    x, y = pixel(balls, camera, (0.3, 0, 0))
    bpy.ops.heritage.pick_object(photo=PHOTO, x=x, y=y)
    assert current() == "Right"


def test_click_isolates_through_the_photo_that_shows_the_place(
    balls: Any, camera: Any, fake_engine: Callable[[str], Path]
) -> None:
    arguments = fake_engine("say('finished', message='ok', outputs={'objects': []})")
    x, y = pixel(balls, camera, (0.3, 0, 0))
    assert bpy.ops.heritage.pick_object(action="ISOLATE", photo=PHOTO, x=x, y=y, name="ball") == {"FINISHED"}
    text = arguments.read_text(encoding="utf-8")
    (click,) = [word for word in eval(text) if word.startswith("--click=")]
    assert click.startswith(f"--click={PHOTO}=")
    found = [float(value) for value in click.rpartition("=")[2].split(",")]
    # The surface of the picked ray is projected to the same photo again.
    assert found == pytest.approx([x, y], abs=0.1)
    assert "--name=ball" in text


def test_scripts_are_told_what_is_missing(balls: Any) -> None:
    with pytest.raises(RuntimeError, match="photo, x, y"):
        bpy.ops.heritage.pick_object()
    with pytest.raises(RuntimeError, match="no camera of the photo"):
        bpy.ops.heritage.pick_object(photo="nowhere.jpg", x=1, y=1)
    listed("Left")
    with pytest.raises(RuntimeError, match="pixels of one photo"):
        bpy.ops.heritage.edit_region(action="ADD")


def test_region_adds_the_surface_and_takes_through_and_the_scene_stays(
    balls: Any, camera: Any, part: Part, tmp_path: Path
) -> None:
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    before = np.array([vertex.co[:] for vertex in whole.data.vertices])
    x, y = pixel(balls, camera, (0.3, 0, 0))
    listed("Left")
    box = corners((x - 12, y - 12), (x + 12, y + 12))
    assert bpy.ops.heritage.edit_region(action="ADD", path=box) == {"FINISHED"}
    added = rows_of(part, "Left") - set(range(100))
    assert added <= set(range(100, 200)) and len(added) > 30, "the wall behind the ball is not added"
    listed("Right")
    assert bpy.ops.heritage.edit_region(action="TAKE", depth="SURFACE", path=box) == {"FINISHED"}
    left = rows_of(part, "Right")
    assert 0 < len(left) < 70
    triangle = corners((x - 20, y - 20), (x + 20, y - 20), (x, y + 5))
    bpy.ops.heritage.edit_region(action="TAKE", path=triangle)
    assert rows_of(part, "Right") < left
    assert np.array_equal(before, [vertex.co[:] for vertex in whole.data.vertices])
    bpy.ops.heritage.export_objects(directory=str(tmp_path), format="PLY")
    exported = part("engine.formats").read_ply(tmp_path / "Left.ply")
    rows = sorted(rows_of(part, "Left"))
    expected = balls.gaussians.means[rows]
    assert len(exported) == len(rows)
    # float32 positions relative to the object's foot.
    nearest = np.abs(exported.means[:, None] - expected[None]).sum(axis=2).min(axis=1)
    assert nearest.max() < 1e-5


def test_nothing_left_of_an_object_is_refused(balls: Any, part: Part) -> None:
    listed("Right")
    everything = corners((1, 1), (127, 95))
    with pytest.raises(RuntimeError, match="Nothing would be left of Right"):
        bpy.ops.heritage.edit_region(action="TAKE", path=everything)
    with pytest.raises(RuntimeError, match="too small"):
        bpy.ops.heritage.edit_region(action="TAKE", path=corners((5, 5), (5, 5)))
    assert rows_of(part, "Right") == set(range(100, 200))


def test_selection_in_edit_mode_is_assigned_taken_and_split(balls: Any, part: Part) -> None:
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    listed("Left")
    select_in_edit_mode(whole, np.arange(110, 130))
    assert bpy.ops.heritage.assign_to_object() == {"FINISHED"}
    assert bpy.context.object.mode == "EDIT"
    assert rows_of(part, "Left") == set(range(100)) | set(range(110, 130))
    bpy.ops.object.mode_set(mode="OBJECT")
    right = listed("Right")
    select_in_edit_mode(right, np.arange(10))
    with pytest.raises(RuntimeError, match="part of Right already"):
        bpy.ops.heritage.assign_to_object()
    listed("Left")
    bpy.ops.heritage.assign_to_object()
    assert rows_of(part, "Right") == set(range(110, 200)) and set(range(100, 110)) < rows_of(part, "Left")
    bpy.ops.object.mode_set(mode="OBJECT")
    select_in_edit_mode(right, np.arange(10, 20))
    assert bpy.ops.heritage.split_object(name="Knauf") == {"FINISHED"}
    assert current() == "Knauf" and bpy.context.object == right
    bpy.ops.object.mode_set(mode="OBJECT")
    assert rows_of(part, "Knauf") == set(range(110, 120)) and current() == "Right"
    assert rows_of(part, "Right") == set(range(120, 200))
    select_in_edit_mode(right, np.arange(20, 30))
    bpy.ops.heritage.take_selection()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert rows_of(part, "Right") == set(range(130, 200))
    select_in_edit_mode(right, np.arange(0))
    with pytest.raises(RuntimeError, match="Nothing is selected"):
        bpy.ops.heritage.take_selection()
    bpy.ops.object.mode_set(mode="OBJECT")


def test_merged_objects_are_one_and_a_deleted_one_is_gone(balls: Any, part: Part) -> None:
    listed("Left")
    assert bpy.ops.heritage.merge_objects(names="Right") == {"FINISHED"}
    assert rows_of(part, "Left") == set(range(200))
    assert "Right" not in bpy.data.objects and "Right" not in bpy.data.collections
    assert current() == "Left"
    with pytest.raises(RuntimeError, match="No isolated object is called 'Nose'"):
        bpy.ops.heritage.merge_objects(names="Nose")
    listed("Vase")
    bpy.ops.heritage.delete_object()
    assert "Vase" not in bpy.data.objects
    assert bpy.context.scene.heritage.deleted.split() == ["right", "vase"]
    bpy.ops.heritage.open_project(directory=str(balls.folder))
    assert rows_of(part, "Left") == set(range(200)), "edits that are not stored survive opening the project again"
    assert "Vase" not in bpy.data.objects


def test_floaters_are_shown_as_a_selection_and_removed_on_request(balls: Any, part: Part) -> None:
    left = listed("Left")
    mesh = left.data
    mesh.vertices[3].co = (5.0, 5.0, 5.0)
    mesh.vertices[4].co = (-5.0, 5.0, 5.0)
    assert bpy.ops.heritage.floaters() == {"FINISHED"}
    assert left.mode == "EDIT"
    left.update_from_editmode()
    assert [vertex.index for vertex in mesh.vertices if vertex.select] == [3, 4]
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.heritage.floaters(remove=True) == {"FINISHED"}
    assert rows_of(part, "Left") == set(range(100)) - {3, 4}
    assert bpy.ops.heritage.floaters() == {"CANCELLED"}


def test_edits_are_stored_in_the_project_by_the_engine(balls: Any, part: Part, installed: str) -> None:
    preferences = bpy.context.preferences.addons[installed].preferences
    preferences.engine_python = os.environ["GAUSSIAN_HERITAGE_PYTHON"]
    try:
        with pytest.raises(RuntimeError, match="has everything that Blender shows"):
            bpy.ops.heritage.store_edits()
        listed("Left")
        bpy.ops.heritage.merge_objects(names="Right")
        wall = bpy.data.objects["Vase"]
        select_in_edit_mode(wall, np.arange(50))
        bpy.ops.heritage.split_object(name="Fenster öst")
        bpy.ops.object.mode_set(mode="OBJECT")
        assert bpy.ops.heritage.store_edits() == {"FINISHED"}
    finally:
        preferences.engine_python = ""
    content, objects = part("engine.project.content"), part("engine.project.objects")
    names = {item.id: item.name for item in content.shown_objects(balls.folder)}
    assert names == {"left": "Left", "vase": "Vase", "fenster-öst": "Fenster öst"}
    stored = objects.load_membership(balls.folder, "left", 600)
    assert np.array_equal(stored >= 0.5, balls.label < 2)
    assert (objects.load_membership(balls.folder, "vase", 600) >= 0.5).sum() == 350
    assert not any(obj.heritage.is_edited for obj in bpy.data.objects) and not bpy.context.scene.heritage.deleted
    assert rows_of(part, "Fenster öst") == set(range(200, 250))


def job_ends(part: Part, project: Any, *ids: str) -> None:
    """Import the objects that a job of this session has changed in the project."""
    job = SimpleNamespace(kind="segment", subject=str(project.folder), command=["--detail"])
    state = part("engine.workers.jobs").JobState(outputs={"objects": list(ids)})
    part("gaussian_heritage_addon.jobs.results").import_results(job, state, bpy.context.scene)


def test_what_is_edited_while_a_job_works_on_the_object_is_not_lost(
    balls: Any, part: Part, draw: Callable[[str], Any]
) -> None:
    left = listed("Left")
    select_in_edit_mode(left, np.arange(30))
    assert bpy.ops.heritage.take_selection() == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    kept = rows_of(part, "Left")
    assert len(kept) == 70
    job_ends(part, balls, "left", "right")
    assert rows_of(part, "Left") == kept and left.heritage.is_edited
    assert "Not stored: Left" in draw("HERITAGE_PT_objects").texts
    # What the job itself has stored counts as stored.
    write_object(balls.folder, "left", "Left", np.isin(np.arange(600), sorted(kept)).astype(np.float32))
    job_ends(part, balls, "left")
    assert rows_of(part, "Left") == kept and not left.heritage.is_edited


def test_end_of_a_job_on_known_objects_leaves_selection_and_eyes(balls: Any, part: Part) -> None:
    listed("Right")
    bpy.data.objects["Left"].heritage.hidden = True
    job_ends(part, balls, "left", "vase")
    assert current() == "Right" and bpy.data.objects["Left"].heritage.hidden
    assert [obj.name for obj in bpy.context.selected_objects] == ["Right"]


def test_panel_offers_the_edits_and_says_what_is_not_stored(balls: Any, draw: Callable[[str], Any]) -> None:
    listed("Left")
    buttons = [(name, options) for name, options in draw("HERITAGE_PT_by_hand").buttons]
    regions = [(options["action"], options["shape"]) for name, options in buttons if name == "heritage.edit_region"]
    assert regions == [("ADD", "LASSO"), ("ADD", "BOX"), ("TAKE", "LASSO"), ("TAKE", "BOX")]
    assert "heritage.store_edits" not in [name for name, _ in draw("HERITAGE_PT_objects").buttons]
    bpy.ops.heritage.merge_objects(names="Right")
    drawn = draw("HERITAGE_PT_objects")
    assert "heritage.store_edits" in [name for name, _ in drawn.buttons]
    assert "Not stored: Left" in drawn.texts and "Deleted, not stored: Right" in drawn.texts


def test_edits_are_not_lost_to_a_correction_by_clicks(balls: Any) -> None:
    listed("Left")
    bpy.ops.heritage.merge_objects(names="Right")
    with pytest.raises(RuntimeError, match="Left was edited by hand. Store its edits first"):
        bpy.ops.heritage.refine_object(level=0)


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 1, 0), (1e-9, 1, 1)])
def test_flattened_scene_is_named_instead_of_clicked_on(balls: Any, scale: tuple[float, float, float]) -> None:
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    # A rotation leaves no exact zero in the matrix.
    whole.rotation_mode, whole.rotation_euler, whole.scale = "XYZ", (0.3, 0.4, 0.5), scale
    bpy.context.view_layer.update()
    listed("Left")
    calls = [
        lambda: bpy.ops.heritage.pick_object(action="ISOLATE", photo=PHOTO, x=50, y=44),
        lambda: bpy.ops.heritage.measure(action="ORIGIN", points_on_photos=corners((50, 44))),
        lambda: bpy.ops.heritage.edit_region(action="ADD", path=corners((40, 30), (60, 60))),
        lambda: bpy.ops.heritage.edit_region(action="TAKE", path=corners((40, 30), (60, 60))),
    ]
    with np.errstate(all="raise"):
        for call in calls:
            with pytest.raises(RuntimeError, match=r"is flattened\. Give it a scale other than 0"):
                call()
