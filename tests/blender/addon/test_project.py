"""A project becomes a scene with cameras and collections. The engine is a fake."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part
from mathutils import Vector


def open_project(project: Any) -> bpy.types.Object:
    assert bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    return next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")


def drawn(obj: bpy.types.Object) -> int:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return sum(1 for instance in depsgraph.object_instances if instance.parent and instance.parent.original == obj)


def test_a_scene_is_named_after_the_folder_of_its_photos(project: Any, part: Part, tmp_path: Path) -> None:
    folder = project.folder.rename(tmp_path / "project")
    photos = tmp_path / "Römische Gläser" / "photos"
    part("engine.project.folder").ProjectFolder.open_existing(folder).put("photo_folder", str(photos))
    assert bpy.ops.heritage.open_project(directory=str(folder)) == {"FINISHED"}
    (scene,) = [obj for obj in bpy.data.objects if obj.heritage.role == "SCENE"]
    assert scene.name == "Römische Gläser"
    assert "Römische Gläser Cameras" in bpy.data.collections


def test_objects_become_collections_with_their_properties(project: Any) -> None:
    scene = open_project(project)
    vase = bpy.data.collections["Vase"]
    (obj,) = vase.objects
    assert (vase["heritage_object_id"], vase["heritage_prompt"], vase["heritage_score"]) == ("vase", "Vase", 0.8)
    assert (obj.heritage.object_id, obj.heritage.prompt) == ("vase", "Vase")
    assert obj.heritage.threshold == pytest.approx(0.5)
    assert len(scene.data.vertices) == 100 and len(obj.data.vertices) == 40
    rows = np.zeros(40, np.int32)
    obj.data.attributes["gaussian_index"].data.foreach_get("value", rows)
    assert rows.tolist() == list(range(40))
    assert bpy.context.scene.render.engine == "CYCLES"


def test_slider_changes_what_is_drawn_and_exported(project: Any, part: Part, tmp_path: Path) -> None:
    open_project(project)
    bpy.context.scene.heritage.show, bpy.context.scene.heritage_display.kind = "OBJECTS", "SHAPES"
    obj = bpy.data.objects["Vase"]
    membership = np.linspace(0.2, 1, 40).astype(np.float32)
    visible = project.gaussians.opacities[:40] > 1 / 255
    for threshold in (0.5, 0.9, 0.0):
        obj.heritage.threshold = threshold
        wanted = membership >= np.float32(threshold)
        assert drawn(obj) == (wanted & visible).sum()
        bpy.ops.heritage.export_objects(directory=str(tmp_path), format="PLY", overwrite=True)
        back = part("engine.formats").read_ply(tmp_path / "Vase.ply")
        np.testing.assert_allclose(back.means, project.gaussians.means[:40][wanted], atol=1e-6)


def test_scene_and_objects_are_never_drawn_twice(project: Any) -> None:
    scene, properties = open_project(project), bpy.context.scene.heritage
    obj = bpy.data.objects["Vase"]
    assert (scene.hide_render, obj.hide_render) == (False, True)
    properties.show = "OBJECTS"
    assert (scene.hide_render, obj.hide_render) == (True, False)


def test_cameras_see_what_the_photos_saw(project: Any, camera: Any) -> None:
    from bpy_extras.object_utils import world_to_camera_view

    open_project(project)
    scene = bpy.context.scene
    assert bpy.ops.heritage.look_through_photo(photo="a b/view 1.jpg") == {"FINISHED"}
    assert (scene.render.resolution_x, scene.render.resolution_y) == (128, 96)
    bpy.context.view_layer.update()
    fx, fy, cx, cy = camera.params
    for point in project.gaussians.means[:20].astype(float):
        x, y, z = camera.viewmat[:3, :3] @ point + camera.viewmat[:3, 3]
        seen = world_to_camera_view(scene, scene.camera, Vector(point))
        # Blender stores lens, shifts and matrices in float32: worst error seen 1e-4 pixels.
        np.testing.assert_allclose((seen.x * 128, (1 - seen.y) * 96), (fx * x / z + cx, fy * y / z + cy), atol=2e-3)


def test_unknown_photo_is_a_clear_error(project: Any) -> None:
    open_project(project)
    with pytest.raises(RuntimeError, match="No camera of the photo 'nowhere'"):
        bpy.ops.heritage.look_through_photo(photo="nowhere")


def test_folder_without_a_scene_is_a_clear_error(blender: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="contains no finished scene"):
        bpy.ops.heritage.open_project(directory=str(tmp_path))


def test_record_is_kept_in_the_project_and_in_exports(project: Any, part: Part, tmp_path: Path) -> None:
    open_project(project)
    properties = bpy.data.objects["Vase"].heritage
    properties.catalogue_number, properties.title, properties.rights = "1906.12", "Gefäß", "CC BY 4.0"
    records = part("engine.project.objects")
    assert records.load_record(project.folder, "vase") == records.MuseumRecord("1906.12", "Gefäß", "CC BY 4.0", "")
    bpy.ops.heritage.export_objects(directory=str(tmp_path), format="PLY")
    bpy.ops.heritage.export_objects(directory=str(tmp_path), format="GLB")
    assert rb"comment title Gef\u00e4\u00df" in (tmp_path / "1906.12 Vase.ply").read_bytes()
    data = (tmp_path / "1906.12 Vase.glb").read_bytes()
    asset = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])["asset"]
    assert asset["copyright"] == "CC BY 4.0"
    assert asset["extras"]["record"]["catalogue_number"] == "1906.12"
    assert asset["extras"]["paradata"]["threshold"] == 0.5
    bpy.ops.wm.read_homefile(use_empty=True)
    open_project(project)
    assert bpy.data.objects["Vase"].heritage.title == "Gefäß"


SEGMENT = """
project = Path(sys.argv[4])
write_object(project, "bust", "Bust", np.r_[np.zeros(90), np.ones(10)].astype(np.float32), score=0.7)
say("finished", message="Isolated Bust (0.70).", outputs={"objects": ["bust"]})
"""


def test_isolate_runs_the_engine_and_adds_a_collection(project: Any, fake_engine: Callable[[str], Path]) -> None:
    scene = open_project(project)
    scene.location = (0, 0, 5)
    bpy.context.view_layer.update()
    arguments = fake_engine(SEGMENT)
    assert bpy.ops.heritage.isolate(prompt=" bust ") == {"FINISHED"}
    assert json.loads(arguments.read_text(encoding="utf-8")) == [
        *["-m", "engine", "segment", str(project.folder), "--prompt=bust", "--events"]
    ]
    bust = bpy.data.collections["Bust"].objects[0]
    assert len(bust.data.vertices) == 10
    foot = np.quantile(project.gaussians.means[90:, 2], 0.01)
    assert bust.matrix_world.translation.z == pytest.approx(foot + 5, abs=1e-5)
    assert scene.hide_render and not bust.hide_render
    assert len([obj for obj in bpy.data.objects if obj.heritage.role == "OBJECT"]) == 2


def test_engine_error_is_shown_to_the_user(project: Any, fake_engine: Callable[[str], Path]) -> None:
    open_project(project)
    fake_engine("say('error', message='No vase was found.', error='PromptError')\nsys.exit(3)")
    with pytest.raises(RuntimeError, match="No vase was found"):
        bpy.ops.heritage.isolate(prompt="vase")


@pytest.mark.parametrize("arguments", [{}, {"prompt": "vase", "photo": "a.jpg"}, {"prompt": "  "}])
def test_ambiguous_request_starts_nothing(project: Any, arguments: dict[str, str]) -> None:
    open_project(project)
    with pytest.raises(RuntimeError, match="Enter what to isolate"):
        bpy.ops.heritage.isolate(**arguments)


def test_photo_folder_is_given_to_the_engine_and_its_scene_imported(
    project: Any, fake_engine: Callable[[str], Path], tmp_path: Path
) -> None:
    photos = tmp_path / "müseum room"
    photos.mkdir()
    arguments = fake_engine("say('finished', message='done', outputs={})")
    assert bpy.ops.heritage.import_photo_folder(directory=str(photos), prompts="vase;bust") == {"FINISHED"}
    expected = ["reconstruct", str(photos), "--out", str(project.folder), "--preset", "standard"]
    assert json.loads(arguments.read_text(encoding="utf-8")) == [
        "-m",
        "engine",
        *expected,
        "--prompts",
        "vase;bust",
        "--events",
    ]
    assert bpy.context.scene.heritage.project == str(project.folder)
    assert bpy.context.scene.camera is not None


def test_masks_and_their_making_are_given_to_the_engine(
    project: Any, fake_engine: Callable[[str], Path], tmp_path: Path
) -> None:
    photos, masks = tmp_path / "photos", tmp_path / "masks"
    photos.mkdir()
    masks.mkdir()
    arguments = fake_engine("say('finished', message='done', outputs={})")
    common = {"directory": str(photos), "project": str(project.folder)}
    assert bpy.ops.heritage.import_photo_folder(**common, masks=str(masks)) == {"FINISHED"}
    assert json.loads(arguments.read_text(encoding="utf-8"))[-3:-1] == ["--photo-masks", str(masks)]
    assert bpy.ops.heritage.import_photo_folder(**common, mask_background=True) == {"FINISHED"}
    assert json.loads(arguments.read_text(encoding="utf-8"))[-2] == "--mask-background"


@pytest.mark.parametrize(("option", "words"), [("light", ["--light"]), ("fisheye", ["--lens", "OPENCV_FISHEYE"])])
def test_a_light_scene_and_a_fisheye_lens_are_asked_for_in_the_import(
    project: Any, fake_engine: Callable[[str], Path], tmp_path: Path, option: str, words: list[str]
) -> None:
    arguments = fake_engine("say('finished', message='done', outputs={})")
    folders = {"directory": str(tmp_path), "project": str(project.folder)}
    assert bpy.ops.heritage.import_photo_folder(**folders, **{option: True}) == {"FINISHED"}
    assert set(words) <= set(json.loads(arguments.read_text(encoding="utf-8")))
    assert bpy.ops.heritage.import_photo_folder(**folders) == {"FINISHED"}
    assert "--light" not in json.loads(arguments.read_text(encoding="utf-8"))


def test_video_is_given_to_the_engine(project: Any, fake_engine: Callable[[str], Path], tmp_path: Path) -> None:
    video = tmp_path / "müseum room.mp4"
    video.write_bytes(b"a video")
    arguments = fake_engine("say('finished', message='done', outputs={})")
    assert bpy.ops.heritage.import_photo_folder(filepath=str(video), project=str(project.folder)) == {"FINISHED"}
    assert json.loads(arguments.read_text(encoding="utf-8"))[2:4] == ["reconstruct", str(video)]
    with pytest.raises(RuntimeError, match="There is no video"):
        bpy.ops.heritage.import_photo_folder(filepath=str(tmp_path / "other.mp4"))


def test_error_without_an_engine_says_what_to_press(
    project: Any, installed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("GAUSSIAN_HERITAGE_PYTHON", raising=False)
    monkeypatch.setenv("GAUSSIAN_HERITAGE_ENGINE", str(tmp_path / "engine"))
    open_project(project)
    for operator in (
        lambda: bpy.ops.heritage.isolate(prompt="vase"),
        lambda: bpy.ops.heritage.import_photo_folder(directory=str(tmp_path)),
        lambda: bpy.ops.heritage.check_engine(),
    ):
        with pytest.raises(RuntimeError, match="Press Set Up Engine in the sidebar or in Preferences"):
            operator()


def test_check_reports_missing_packages(
    blender: ModuleType, installed: str, fake_engine: Callable[[str], Path]
) -> None:
    fake_engine(
        "say('finished', message='ok numpy', outputs={'checks': [{'name': 'torch', 'ok': False, 'required': True}]})"
    )
    with pytest.raises(RuntimeError, match="lacks torch"):
        bpy.ops.heritage.check_engine()
    assert bpy.context.preferences.addons[installed].preferences.check_result == "ok numpy"


def test_cancel_without_a_job_is_a_clear_error(blender: ModuleType) -> None:
    with pytest.raises(RuntimeError, match="No job is running"):
        bpy.ops.heritage.cancel_job()


def test_every_typed_property_is_registered(part: Part) -> None:
    """A class without the decorator `blender_properties` would lose its properties silently."""
    for operator in part("operators").CLASSES:
        if issubclass(operator, bpy.types.Operator):
            registered = getattr(bpy.ops.heritage, operator.bl_idname.partition(".")[2]).get_rna_type().properties
            assert set(vars(operator).get("__annotations__", {})) <= set(registered.keys()), operator
    addon = "gaussian_heritage_addon"
    for group in [*part(f"{addon}.splats.properties").CLASSES, *part(f"{addon}.panels.preferences_page").CLASSES]:
        assert set(group.__annotations__) <= set(group.bl_rna.properties.keys()), group
