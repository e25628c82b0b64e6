"""A .blend file and its project are moved together, or the project is gone."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest
from conftest import Part, isolated


@pytest.fixture
def saved(opened: Any, tmp_path: Path, part: Part) -> Iterator[Path]:
    """Save a .blend beside the opened project, and return the file where both were moved."""
    loan = tmp_path / "loan"
    loan.mkdir()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    opened.folder = opened.folder.rename(loan / opened.folder.name)
    bpy.ops.heritage.open_project(directory=str(opened.folder))
    bpy.ops.wm.save_as_mainfile(filepath=str(loan / "scene.blend"))
    yield loan.rename(tmp_path / "archive") / "scene.blend"
    part("gaussian_heritage_addon.blender.problems").clear()


def projects(part: Part) -> set[Path]:
    project_of = part("gaussian_heritage_addon.splats.properties").project_of
    holders = (*bpy.data.scenes, *bpy.data.objects)
    return {project_of(one.heritage) for one in holders if one.heritage.project}


def test_a_project_moved_with_its_blend_is_found(saved: Path, opened: Any, part: Part) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    assert projects(part) == {saved.parent / opened.folder.name}
    assert bpy.context.scene.heritage.project == f"//{opened.folder.name}"


def test_a_copy_saved_elsewhere_leaves_the_paths_of_this_file(saved: Path, opened: Any, part: Part) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    far = saved.parent.parent / "a" / "b" / "c"
    far.mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(far / "copy.blend"), copy=True)
    assert projects(part) == {saved.parent / opened.folder.name}
    bpy.ops.wm.open_mainfile(filepath=str(far / "copy.blend"))
    assert projects(part) == {saved.parent / opened.folder.name}


def test_a_blend_moved_alone_finds_its_project_where_it_stayed(saved: Path, opened: Any, part: Part) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    bpy.ops.wm.save_mainfile()
    far = saved.parent.parent / "a" / "b" / "c"
    far.mkdir(parents=True)
    moved = saved.rename(far / "scene.blend")
    bpy.ops.wm.open_mainfile(filepath=str(moved))
    assert projects(part) == {saved.parent / opened.folder.name}
    assert part("gaussian_heritage_addon.blender.problems").shown() == ""
    # A path of someone else that no folder can have is not looked at.
    bpy.context.scene.heritage.project = "//gone"
    bpy.context.scene["heritage_project_place"] = "/" + "x" * 5000
    part("gaussian_heritage_addon.project.moved_projects").find_moved()
    assert "gone is missing" in part("gaussian_heritage_addon.blender.problems").shown()


def test_a_stored_absolute_path_is_looked_for_beside_the_blend(saved: Path, opened: Any, part: Part) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    moved = projects(part).pop()
    before = part("gaussian_heritage_addon.project.moved_projects")._stored
    part("gaussian_heritage_addon.project.moved_projects")._stored = lambda project, folder: str(project)
    bpy.ops.wm.save_mainfile()
    part("gaussian_heritage_addon.project.moved_projects")._stored = before
    archive = saved.parent.rename(saved.parent.parent / "elsewhere")
    bpy.ops.wm.open_mainfile(filepath=str(archive / "scene.blend"))
    assert projects(part) == {archive / moved.name}


def test_another_project_of_the_same_name_is_not_taken(saved: Path, opened: Any, part: Part) -> None:
    folder = saved.parent / opened.folder.name
    shutil.rmtree(folder / "cameras")
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    moved_projects = part("gaussian_heritage_addon.project.moved_projects")
    assert not moved_projects._fits(folder, folder)


def test_a_missing_project_is_said_and_chosen_by_one_button(saved: Path, opened: Any, part: Part, draw: Any) -> None:
    folder = saved.parent / opened.folder.name
    away = folder.rename(saved.parent.parent / "away")
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    assert str(folder) in part("gaussian_heritage_addon.blender.problems").shown()
    layout = draw("HERITAGE_PT_scene")
    assert "heritage.find_project" in [name for name, _ in layout.buttons]
    with pytest.raises(RuntimeError, match="far Gaussians"):
        bpy.ops.heritage.export_objects(directory=str(saved.parent / "out"), scope="SCENE")
    assert not bpy.ops.heritage.isolate.poll()
    vase = isolated()["vase"]
    assert bpy.ops.heritage.find_project(directory=str(away)) == {"FINISHED"}
    assert projects(part) == {away} and isolated()["vase"] == vase
    with pytest.raises(RuntimeError, match="No project of this scene is missing"):
        bpy.ops.heritage.find_project(directory=str(away))


def test_opening_a_moved_project_relinks_its_scene(saved: Path, opened: Any, part: Part) -> None:
    away = (saved.parent / opened.folder.name).rename(saved.parent.parent / "away")
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    scenes = len(bpy.data.scenes)
    bpy.ops.heritage.open_project(directory=str(away))
    assert len(bpy.data.scenes) == scenes and projects(part) == {away}
    assert len([obj for obj in bpy.data.objects if obj.heritage.role == "OBJECT"]) == 1


@pytest.mark.parametrize("link", [False, True])
def test_an_object_of_another_file_keeps_its_project(
    saved: Path, opened: Any, part: Part, tmp_path: Path, link: bool
) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    (tmp_path / "other").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other" / "other.blend"))
    command = bpy.ops.wm.link if link else bpy.ops.wm.append
    assert command(directory=f"{saved}/Object/", filename="Vase") == {"FINISHED"}
    assert projects(part) == {saved.parent / opened.folder.name}
