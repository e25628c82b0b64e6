"""A .blend file of release 0.1.0 opens in this release, and its sliders, objects and exports still work."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import bpy
import pytest

Part = Callable[[str], ModuleType]


@pytest.fixture
def release(blender: ModuleType, tmp_path: Path) -> Path:
    """Copy the project of the release to a new place, open its .blend file, and return the copy."""
    copy = tmp_path / "first_release"
    shutil.copytree(Path(os.environ["GAUSSIAN_HERITAGE_FIXTURES"]) / "first_release", copy)
    bpy.ops.wm.open_mainfile(filepath=str(copy / "scene.blend"))
    return copy


def objects(role: str) -> dict[str, bpy.types.Object]:
    return {obj.name: obj for obj in bpy.context.scene.objects if obj.heritage.role == role}


def drawn(obj: bpy.types.Object) -> int:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return sum(1 for instance in depsgraph.object_instances if instance.parent and instance.parent.original == obj)


def test_file_opens_with_its_scene_objects_and_records(release: Path) -> None:
    assert {name: len(obj.data.vertices) for name, obj in objects("SCENE").items()} == {"project": 400}
    assert {name: len(obj.data.vertices) for name, obj in objects("OBJECT").items()} == {"box": 10, "teapot": 10}
    teapot = objects("OBJECT")["teapot"].heritage
    assert (teapot.object_id, teapot.kind, teapot.title, teapot.catalogue_number) == (
        "teapot", "click", "Teapot", "1925.7",
    )  # fmt: skip
    assert teapot.threshold == pytest.approx(0.6) and teapot.n_levels == 2
    # It was /museum/first_release/project, and is found beside the file.
    assert bpy.context.scene.heritage.project == "//project"
    assert bpy.context.scene.heritage.blending == "TRAINED"


def test_threshold_and_levels_still_work(release: Path) -> None:
    bpy.context.scene.heritage.show = "OBJECTS"
    teapot = objects("OBJECT")["teapot"]
    counts = []
    for threshold in (0.0, 0.6, 1.0):
        teapot.heritage.threshold = threshold
        counts.append(drawn(teapot))
    assert counts == sorted(counts, reverse=True) and counts[0] > 0
    teapot.heritage.threshold, teapot.heritage.project = 0.5, str(release / "project")
    whole = drawn(teapot)
    teapot.heritage.level = 0
    assert teapot.heritage.problem == ""
    assert 0 < drawn(teapot) < whole


def test_objects_are_exported_and_imported_again(release: Path, part: Part, tmp_path: Path) -> None:
    for file_format in ("PLY", "GLB"):
        bpy.ops.heritage.export_objects(directory=str(tmp_path), format=file_format, scope="ALL")
    formats = part("engine.formats")
    assert len(formats.read_ply(tmp_path / "box.ply")) == len(formats.read_glb(tmp_path / "box.glb")) == 9
    bpy.ops.wm.read_homefile(use_empty=True)
    assert bpy.ops.heritage.open_project(directory=str(release / "project")) == {"FINISHED"}
    assert objects("OBJECT")["teapot"].heritage.title == "Teapot"
