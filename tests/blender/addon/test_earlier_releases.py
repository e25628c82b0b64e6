"""A .blend file of an earlier release shows its scene and objects, finds its project, and exports."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import bpy
import pytest
from conftest import isolated

RELEASES = sorted(path.name for path in (Path(os.environ["GAUSSIAN_HERITAGE_FIXTURES"]) / "releases").glob("*.*.*"))


@pytest.mark.parametrize("release", RELEASES)
def test_file_of_an_earlier_release_is_as_it_was(
    release: str, part: Callable[[str], ModuleType], tmp_path: Path
) -> None:
    source = Path(os.environ["GAUSSIAN_HERITAGE_FIXTURES"]) / "releases" / release
    room = Path(shutil.copytree(source, tmp_path / "moved room"))
    bpy.ops.wm.open_mainfile(filepath=str(room / "scene.blend"))
    (scene,) = [obj for obj in bpy.data.objects if obj.heritage.role == "SCENE"]
    exhibit = isolated()["exhibit"]
    assert 0 < len(exhibit.data.vertices) < len(scene.data.vertices) == 400
    assert "Exhibit" in bpy.data.collections
    exported = tmp_path / "exported"
    exported.mkdir()
    bpy.ops.heritage.export_objects(directory=str(exported), format="GLB", scope="ALL")
    assert [file.name for file in exported.iterdir()] == ["Exhibit.glb"]
    project_of = part("gaussian_heritage_addon.splats.properties").project_of
    assert project_of(bpy.context.scene.heritage) == room / "project"


def test_there_is_a_release() -> None:
    assert RELEASES
