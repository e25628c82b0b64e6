"""Sizes and positions are the same in Blender, project and exported files, whatever the .blend went through."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part, isolated, write_object

METRES = 2.123
PHOTO = "a b/view 1.jpg"
MEMBERS = np.linspace(0.2, 1, 40).astype(np.float32) >= 0.5
"""Which of the 40 Gaussians of the vase are shown at its threshold."""


@pytest.fixture
def measured(opened: Any, part: Part) -> Any:
    """Return the opened project, measured in this Blender: 2.123 m a unit, a tilted ground and an origin."""
    scene = part("engine.scene")
    distances = (scene.MeasuredDistance((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), METRES),)
    ground = ((0.0, 0.0, 0.1), (1.0, 0.0, 0.2), (0.0, 1.0, 0.3))
    measurement = scene.Measurement(distances, ground=ground, origin=(0.3, 0.1, 0.2))
    part("gaussian_heritage_addon.project.measuring").measure(bpy.context.scene, measurement)
    return opened


def vase() -> bpy.types.Object:
    return isolated()["vase"]


def reopen(folder: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))


def change_place(obj: bpy.types.Object) -> None:
    obj.location.x += 0.4
    obj.rotation_euler = (0.3, -0.2, 1.1)
    obj.scale *= 1.7


def created(folder: Path) -> None:
    """Leave everything as it is."""


def reopened(folder: Path) -> None:
    bpy.context.scene.heritage.show = "OBJECTS"
    reopen(folder)


def reopened_as_scene(folder: Path) -> None:
    bpy.context.scene.heritage.show = "SCENE"
    reopen(folder)


def reopened_with_closed_eye(folder: Path) -> None:
    bpy.context.scene.heritage.show = "OBJECTS"
    vase().heritage.hidden = True
    reopen(folder)


def reopened_in_a_hidden_collection(folder: Path) -> None:
    vase().users_collection[0].hide_viewport = True
    reopen(folder)


def moved(folder: Path) -> None:
    change_place(vase())


def moved_and_reopened(folder: Path) -> None:
    change_place(vase())
    reopened_with_closed_eye(folder)


def undone(folder: Path) -> None:
    """Do what Ctrl+Z does: read an earlier state. Blender as a Python module does not end after a real undo."""
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "earlier.blend"), copy=True)
    change_place(vase())
    bpy.ops.wm.open_mainfile(filepath=str(folder / "earlier.blend"))
    for handler in bpy.app.handlers.undo_post:
        handler(bpy.context.scene, None)


def redone(folder: Path) -> None:
    change_place(vase())
    undone(folder)


def parented(folder: Path) -> None:
    stand = bpy.data.objects.new("Stand", None)
    bpy.context.scene.collection.objects.link(stand)
    obj = vase()
    obj.parent = stand
    stand.location, stand.scale, stand.rotation_euler = (1, 2, 3), (0.5, 0.5, 0.5), (0.1, 0.2, 0.3)
    stand.hide_viewport = True
    reopened_with_closed_eye(folder)


def with_delta_transforms(folder: Path) -> None:
    obj = vase()
    obj.delta_location, obj.delta_scale, obj.delta_rotation_euler = (0.1, 0.2, 0.3), (2, 2, 2), (0.3, 0.2, 0.1)
    reopened_with_closed_eye(folder)


def held_by_a_constraint(folder: Path) -> None:
    hook = bpy.data.objects.new("Hook", None)
    bpy.context.scene.collection.objects.link(hook)
    hook.location = (3, 2, 1)
    vase().constraints.new("COPY_LOCATION").target = hook
    reopened_with_closed_eye(folder)


def with_applied_transform(folder: Path) -> None:
    change_place(vase())
    apply_transform(vase())
    reopened_with_closed_eye(folder)


def in_a_second_scene(folder: Path) -> None:
    obj = vase()
    bpy.context.window.scene = bpy.data.scenes.new("Second")
    bpy.context.scene.collection.objects.link(obj)
    obj.heritage.hidden = True
    reopen(folder)


def appended(folder: Path, link: bool = False) -> None:
    reopened_with_closed_eye(folder)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    command = bpy.ops.wm.link if link else bpy.ops.wm.append
    command(directory=f"{folder / 'scene.blend'}/Object/", filename="Vase")


def linked(folder: Path) -> None:
    appended(folder, link=True)


def apply_transform(obj: bpy.types.Object) -> None:
    bpy.context.scene.heritage.show = "OBJECTS" if obj.heritage.role == "OBJECT" else "SCENE"
    for other in bpy.context.scene.objects:
        other.select_set(other == obj)
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.object.transform_apply(location=True, rotation=True, scale=True) == {"FINISHED"}
    bpy.context.view_layer.update()


LIVES = [
    created,
    reopened,
    reopened_as_scene,
    reopened_with_closed_eye,
    reopened_in_a_hidden_collection,
    moved,
    moved_and_reopened,
    undone,
    redone,
    parented,
    with_delta_transforms,
    held_by_a_constraint,
    with_applied_transform,
    in_a_second_scene,
    appended,
    linked,
]


def drawn(obj: bpy.types.Object) -> np.ndarray:
    """Return where Blender draws the vertices of an object once it is shown."""
    scene = bpy.data.scenes.new("Shown")
    helper = bpy.data.objects.new("Helper", None)
    helper.constraints.new("COPY_TRANSFORMS").target = obj
    scene.collection.objects.link(helper)
    scene.view_layers[0].update()
    matrix = np.array(helper.evaluated_get(scene.view_layers[0].depsgraph).matrix_world)
    bpy.data.scenes.remove(scene)
    bpy.data.objects.remove(helper)
    return by(matrix, np.array([vertex.co for vertex in obj.data.vertices]))


def by(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def size(gaussians: Any) -> float:
    """Return the mean extent of Gaussians, which no rotation changes."""
    return float(np.exp(gaussians.log_scales.astype(np.float64).sum(axis=1) / 3).mean())


def read(part: Part, file: Path) -> Any:
    formats = part("engine.formats")
    if file.suffix == ".ply":
        return formats.read_ply(file)
    return formats.read_other(file, file.suffix.removeprefix("."), None, up=None)


@pytest.mark.parametrize("life", LIVES, ids=lambda life: life.__name__)
def test_blender_project_and_files_agree_whatever_the_file_went_through(
    life: Callable[[Path], None], measured: Any, part: Part, tmp_path: Path
) -> None:
    life(tmp_path)
    obj = vase()
    shown = part("gaussian_heritage_addon.splats.splats").SplatScene.of(obj).gaussians(0.5)
    folder, files = tmp_path / "out", {}
    for file_format in ("PLY", "GLB", "SPZ"):
        bpy.ops.heritage.export_objects(directory=str(folder), format=file_format, scope="ALL", with_hidden=True)
        (file,) = folder.glob(f"*.{file_format.lower()}")
        files[file_format] = read(part, file)
    # Last: it makes Blender evaluate the object, which hides what is stale.
    points = drawn(obj)
    np.testing.assert_allclose(shown.means, points[MEMBERS], atol=1e-5)
    for file_format, written in files.items():
        # SPZ has steps of 1/16384 of the extent, and of 1/16 of a logarithm.
        np.testing.assert_allclose(written.means, points[MEMBERS], atol=1e-3 if file_format == "SPZ" else 1e-5)
        assert size(written) == pytest.approx(size(shown), rel=0.05 if file_format == "SPZ" else 1e-5)
    if life in (created, reopened, reopened_as_scene, reopened_with_closed_eye, undone, in_a_second_scene, appended):
        measurement = part("engine.scene").load_measurement(measured.folder)
        stored = by(measurement.measured_from_world, measured.gaussians.means[:40])
        np.testing.assert_allclose(points, stored, atol=1e-5)
        assert size(shown) == pytest.approx(METRES * size(measured.gaussians[np.flatnonzero(MEMBERS)]), rel=1e-5)


def go_on(part: Part, folder: Path, out: Path) -> dict[str, Any]:
    """Isolate, measure again, split, measure with a ruler and export, and return every number that a curator sees."""
    scene = bpy.context.scene
    scene_file, world = (
        part("gaussian_heritage_addon.project.scene_file"),
        part("gaussian_heritage_addon.blender.world_placement"),
    )
    write_object(folder, "teapot", "Teapot", np.r_[np.zeros(60), np.linspace(0.2, 1, 40)].astype(np.float32))
    scene_file.add_objects(scene, folder, ["teapot"])
    ends = [{"name": "", "photo": PHOTO, "x": x, "y": y, "wanted": True} for x, y in ((64.0, 48.0), (75.0, 40.0))]
    seen = {"before": drawn(isolated()["teapot"])}
    assert bpy.ops.heritage.measure(action="DISTANCE", metres=1.5, points_on_photos=ends) == {"FINISHED"}
    assert bpy.ops.heritage.measure(action="RULER", points_on_photos=ends) == {"FINISHED"}
    ((ruler, length),) = part("gaussian_heritage_addon.project.measuring").rulers(scene)
    measurement = part("engine.scene").load_measurement(folder)
    assert length == pytest.approx(measurement.distances[-1].units * measurement.metres_per_unit, rel=1e-5)
    scene.heritage.show = "OBJECTS"
    source = isolated()["vase"]
    bpy.context.view_layer.objects.active = source
    source.data.vertices.foreach_set("select", np.arange(40) >= 20)
    assert bpy.ops.heritage.split_object(name="Part") == {"FINISHED"}
    bpy.ops.heritage.export_objects(directory=str(out), format="GLB", scope="ALL", with_hidden=True)
    objects = {obj.name: obj for obj in scene.objects}
    seen |= {name: drawn(obj) for name, obj in objects.items() if obj.type == "MESH"}
    seen |= {obj.name: world.world_matrix(obj) for obj in objects.values() if obj.type == "CAMERA"}
    seen |= {file.name: read(part, file).means for file in out.iterdir()}
    return {**seen, "ruler": np.array([length]), "ruler drawn": np.ptp(drawn(ruler), axis=0)}


@pytest.mark.parametrize(
    "life", [reopened, reopened_as_scene, reopened_with_closed_eye], ids=lambda life: life.__name__
)
def test_work_goes_on_after_reopening_as_if_the_file_had_never_been_closed(
    life: Callable[[Path], None], measured: Any, part: Part, tmp_path: Path
) -> None:
    kept = tmp_path / "kept"
    shutil.copytree(measured.folder, kept)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"), copy=True)
    never_closed = go_on(part, measured.folder, tmp_path / "never closed")
    shutil.rmtree(measured.folder)
    shutil.copytree(kept, measured.folder)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    life(tmp_path)
    again = go_on(part, measured.folder, tmp_path / "again")
    assert again.keys() == never_closed.keys() and len(again) >= 9
    for name, values in never_closed.items():
        np.testing.assert_allclose(again[name], values, atol=1e-5, err_msg=name)


def test_reopened_file_keeps_its_cameras_when_it_is_measured(
    project: Any, part: Part, camera: Any, tmp_path: Path
) -> None:
    scene_part, measuring = part("engine.scene"), part("gaussian_heritage_addon.project.measuring")
    folder = project.folder / "cameras"
    viewmat = camera.viewmat.copy()
    viewmat[:3, 3] += (0.1, 0.2, 0.3)
    cameras = (camera, replace(camera, photo="view 2.jpg", viewmat=viewmat))
    part("engine.scene.camera_storage").write_camera_set(
        folder, replace(scene_part.read_camera_set(folder), cameras=cameras)
    )
    bpy.ops.heritage.open_project(directory=str(project.folder))
    reopened(tmp_path)
    longer = (scene_part.MeasuredDistance((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 5.0),)
    measuring.measure(bpy.context.scene, scene_part.Measurement(longer, origin=(1.0, 1.0, 1.0)))
    placement = scene_part.load_measurement(project.folder).measured_from_world
    placed = {obj["heritage_photo"]: np.array(obj.location) for obj in bpy.data.objects if obj.type == "CAMERA"}
    assert len(placed) == 2
    for one in cameras:
        np.testing.assert_allclose(placed[one.photo], by(placement, one.center), atol=1e-4)
    assert measuring.length_text(bpy.context.scene, 1.0) == "1.000 m"


def test_every_scene_that_shows_the_project_is_measured(measured: Any, part: Part) -> None:
    first = bpy.context.scene
    bpy.ops.scene.new(type="FULL_COPY")
    measuring, scene_part = part("gaussian_heritage_addon.project.measuring"), part("engine.scene")
    measuring.measure(first, scene_part.Measurement())
    world = part("gaussian_heritage_addon.blender.world_placement")
    wholes = [obj for obj in bpy.data.objects if obj.heritage.role == "SCENE"]
    assert len(wholes) == 2
    for whole in wholes:
        np.testing.assert_allclose(world.world_matrix(whole), np.eye(4), atol=1e-5)


def test_an_object_of_another_project_keeps_its_size_when_the_scene_is_measured(measured: Any, part: Part) -> None:
    other = bpy.data.objects.new("Visitor", vase().data.copy())
    bpy.context.scene.collection.objects.link(other)
    other.heritage.role, other.heritage.project = "OBJECT", str(measured.folder.parent / "other_heritage")
    other.scale = (3, 3, 3)
    part("gaussian_heritage_addon.project.measuring").measure(bpy.context.scene, part("engine.scene").Measurement())
    assert tuple(other.scale) == (3, 3, 3)


def test_an_object_that_cannot_be_placed_is_named_and_nothing_is_measured(measured: Any, part: Part) -> None:
    obj = vase()
    obj.keyframe_insert("location", frame=1)
    obj.keyframe_insert("scale", frame=1)
    measuring = part("gaussian_heritage_addon.project.measuring")
    before = measuring.current_measurement(measured.folder)
    whole = next(one for one in bpy.data.objects if one.heritage.role == "SCENE")
    place = np.array(whole.matrix_basis)
    with pytest.raises(part("engine.core.errors").ObjectError, match="Vase cannot be placed, because .* an animation"):
        measuring.measure(bpy.context.scene, part("engine.scene").Measurement())
    assert measuring.current_measurement(measured.folder) == before
    np.testing.assert_allclose(np.array(whole.matrix_basis), place, atol=1e-6)


@pytest.mark.parametrize("changed", ["applied", "origin", "joined", "joined into another"])
def test_an_updated_object_stays_where_it_is_after_its_vertices_were_moved(
    changed: str, measured: Any, part: Part
) -> None:
    scene_file = part("gaussian_heritage_addon.project.scene_file")
    obj = vase()
    change_place(obj)
    wanted = drawn(obj)
    if changed == "applied":
        apply_transform(obj)
    elif changed == "origin":
        bpy.context.scene.heritage.show = "OBJECTS"
        obj.select_set(True)
        bpy.ops.object.origin_set(type="ORIGIN_GEOMETRY", center="BOUNDS")
    else:
        write_object(measured.folder, "teapot", "Teapot", np.r_[np.zeros(45), np.ones(55)].astype(np.float32))
        scene_file.add_objects(bpy.context.scene, measured.folder, ["teapot"])
        bpy.context.scene.heritage.show = "OBJECTS"
        teapot = isolated()["teapot"]
        change_place(teapot)
        if changed == "joined into another":
            obj, wanted = teapot, drawn(teapot)
        for other in bpy.context.scene.objects:
            other.select_set(other in (obj, teapot, vase()))
        bpy.context.view_layer.objects.active = obj
        assert bpy.ops.object.join() == {"FINISHED"}
    bpy.context.view_layer.update()
    scene_file.add_objects(bpy.context.scene, measured.folder, [obj.heritage.object_id])
    np.testing.assert_allclose(drawn(obj), wanted, atol=1e-4)


def test_a_scene_whose_transform_was_applied_is_measured_and_updated_right(
    measured: Any, part: Part, camera: Any, tmp_path: Path
) -> None:
    scene = bpy.context.scene
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    apply_transform(whole)
    assert tuple(whole.scale) == (1, 1, 1)
    measuring, scene_part = part("gaussian_heritage_addon.project.measuring"), part("engine.scene")
    placement = scene_part.load_measurement(measured.folder).measured_from_world
    np.testing.assert_allclose(
        measuring.scene_points(scene, [by(placement, camera.center)]), [camera.center], atol=1e-5
    )
    # Points on photos, a new object, and the scene trained again.
    write_object(measured.folder, "teapot", "Teapot", np.r_[np.zeros(60), np.ones(40)].astype(np.float32))
    part("gaussian_heritage_addon.project.scene_file").add_objects(scene, measured.folder, ["teapot"])
    np.testing.assert_allclose(drawn(isolated()["teapot"]), by(placement, measured.gaussians.means[60:]), atol=1e-5)
    bpy.ops.heritage.open_project(directory=str(measured.folder))
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    np.testing.assert_allclose(drawn(whole), by(placement, measured.gaussians.means), atol=1e-5)
    measuring.measure(scene, scene_part.Measurement())
    np.testing.assert_allclose(drawn(whole), measured.gaussians.means, atol=1e-5)
    np.testing.assert_allclose(drawn(isolated()["teapot"]), measured.gaussians.means[60:], atol=1e-5)


def test_parts_of_a_moved_object_stay_where_they_are_seen(measured: Any) -> None:
    bpy.context.scene.heritage.show = "OBJECTS"
    obj = vase()
    change_place(obj)
    wanted = drawn(obj)[20:]
    bpy.context.view_layer.objects.active = obj
    obj.data.vertices.foreach_set("select", np.arange(40) >= 20)
    assert bpy.ops.heritage.split_object(name="Part") == {"FINISHED"}
    np.testing.assert_allclose(drawn(bpy.data.objects["Part"]), wanted, atol=1e-5)


@pytest.mark.parametrize("file_format", ["PLY", "GLB", "SPZ"])
def test_joined_objects_are_exported_as_they_were_seen_apart(
    file_format: str, measured: Any, part: Part, tmp_path: Path
) -> None:
    scene_file, splats = (
        part("gaussian_heritage_addon.project.scene_file"),
        part("gaussian_heritage_addon.splats.splats").SplatScene,
    )
    write_object(measured.folder, "teapot", "Teapot", np.r_[np.zeros(45), np.ones(55)].astype(np.float32))
    scene_file.add_objects(bpy.context.scene, measured.folder, ["teapot"])
    bpy.context.scene.heritage.show = "OBJECTS"
    first, second = vase(), isolated()["teapot"]
    change_place(second)
    seen = splats.of(first).gaussians(0.5).joined(splats.of(second).gaussians(0.5))
    for obj in bpy.context.scene.objects:
        obj.select_set(obj in (first, second))
    bpy.context.view_layer.objects.active = first
    assert bpy.ops.object.join() == {"FINISHED"}
    reopened_with_closed_eye(tmp_path)
    bpy.ops.heritage.export_objects(directory=str(tmp_path / "out"), format=file_format, with_hidden=True)
    (file,) = (tmp_path / "out").iterdir()
    written = read(part, file)
    np.testing.assert_allclose(written.means, seen.means, atol=1e-3 if file_format == "SPZ" else 1e-4)
    assert size(written) == pytest.approx(size(seen), rel=0.05 if file_format == "SPZ" else 1e-3)


@pytest.mark.parametrize("frame", [[0.0] * 16, [1.0] * 3, "none", [float("nan")] * 16, 7])
def test_a_frame_that_was_changed_in_a_file_is_one_sentence(frame: Any, measured: Any, part: Part) -> None:
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    whole.data["heritage_frame"] = frame
    whole.data.vertices[0].co.x += 1
    bpy.context.view_layer.update()
    with pytest.raises(part("engine.core.errors").ObjectError, match=r"The frame of .* was changed\. Open the project"):
        part("gaussian_heritage_addon.project.measuring").scene_points(bpy.context.scene, [np.zeros(3)])
