"""Blender, the project and exported files have the same objects: after edits, undo, redo, saving, moving, appending."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import isolated, write_object

Part = Callable[[str], ModuleType]
Shown = dict[str, int]
"""Gaussians of each object, by name."""
StandIn = Callable[[str], Path]

ENGINE = """
import os
sys.path.insert(0, os.environ["PYTHONPATH"])
from engine.project_folder import ProjectFolder
from engine.records import delete_object, keep_version
project = Path(sys.argv[4])
opened = ProjectFolder.open_existing(project)
rows = lambda first, last, value=1: np.where((np.arange(100) >= first) & (np.arange(100) < last), value, 0).astype("f4")
"""
"""What the engine does with the trash, which the stand-ins of it below do as well."""


@pytest.fixture
def museum(project: Any, blender: ModuleType) -> Iterator[Any]:
    """A project of 100 Gaussians with the objects vase (rows 0 to 40), cup and background, opened in a saved file."""
    write_object(project.folder, "cup", "Cup", np.r_[np.zeros(60), np.ones(20), np.zeros(20)].astype(np.float32))
    assert bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    bpy.context.scene.heritage.show = "OBJECTS"
    step()
    yield project


def step() -> None:
    """End a step of the user, as Blender does after each."""
    bpy.context.view_layer.update()
    bpy.ops.ed.undo_push(message="step")


def undo() -> None:
    bpy.ops.ed.undo()
    bpy.context.view_layer.update()


def redo() -> None:
    bpy.ops.ed.redo()
    bpy.context.view_layer.update()


def in_blender(part: Part) -> Shown:
    """Return what Blender shows. An object, its own collection and its row in the list have the same name."""
    rows = part("gaussian_heritage_addon.hand_edits").member_rows
    found = {}
    for obj in bpy.context.scene.objects:
        if obj.heritage.role == "OBJECT":
            assert obj.name in [collection.name for collection in obj.users_collection], obj.name
            found[obj.name] = len(rows(obj))
    return found


def in_project(part: Part, folder: Path) -> Shown:
    """Return what the project has: the record and the stored memberships agree."""
    content, found = part("engine.project_content"), {}
    for item in content.list_objects(folder):
        content.require_intact(folder, item.id)
        members = content.load_membership(folder, item.id, 100) >= np.float32(item.threshold)
        assert members.sum() == item.n_gaussians, item
        found[item.name] = item.n_gaussians
    return found


def in_files(part: Part, folder: Path) -> Shown:
    shutil.rmtree(folder, ignore_errors=True)
    if not isolated():
        return {}
    assert bpy.ops.heritage.export_objects(directory=str(folder), scope="ALL") == {"FINISHED"}
    return {file.stem: len(part("engine.formats").read_ply(file)) for file in folder.glob("*.ply")}


def problem(part: Part) -> str:
    return str(part("gaussian_heritage_addon.problems").shown())


# ---- what a user does, from one agreeing state to another


def isolate(fake_engine: StandIn) -> None:
    fake_engine(
        ENGINE
        + """
write_object(project, "pot", "Tea Pot", rows(80, 95))
say("finished", outputs={"objects": ["pot"]})
"""
    )
    bpy.ops.heritage.isolate(prompt="tea pot")


def correct(fake_engine: StandIn) -> None:
    fake_engine(
        ENGINE
        + """
with opened:
    keep_version(opened, "vase", why="corrected")
write_object(project, "vase", "Vase", rows(0, 33))
say("finished", outputs={"objects": ["vase"]})
"""
    )
    bpy.ops.heritage.refine_object(
        object_id="vase", clicks=[{"name": "", "photo": "a", "x": 1, "y": 1, "wanted": True}]
    )


def find_all(fake_engine: StandIn) -> None:
    fake_engine(
        ENGINE
        + """
write_object(project, "object-1", "object 1", rows(80, 90))
write_object(project, "object-2", "object 2", rows(90, 95))
write_object(project, "background", "background", rows(40, 60), prompt={"kind": "background"})
say("finished", outputs={"objects": ["object-1", "object-2", "background"], "kept": ["vase", "cup"]})
"""
    )
    bpy.ops.heritage.find_objects()


def rename(_: StandIn) -> None:
    isolated()["vase"].name = "Urn of Ur"


def rename_collection(_: StandIn) -> None:
    bpy.data.collections["Vase"].name = "Urn"


def rename_to_a_name_in_use(_: StandIn) -> None:
    isolated()["vase"].name = "Cup"


def rename_to_what_projects_change(_: StandIn) -> None:
    isolated()["vase"].name = "  Urn   of  Ur "


def store() -> None:
    step()
    assert bpy.ops.heritage.store_edits() == {"FINISHED"}


def listed(name: str) -> None:
    bpy.context.scene.heritage.active = bpy.data.objects.find(name)


def take_by_hand(_: StandIn) -> None:
    vase = isolated()["vase"]
    bpy.context.view_layer.objects.active = vase
    for vertex in vase.data.vertices:
        vertex.select = vertex.index > 35
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.heritage.take_selection()
    bpy.ops.object.mode_set(mode="OBJECT")
    store()


def split(_: StandIn) -> None:
    vase = isolated()["vase"]
    bpy.context.view_layer.objects.active = vase
    for vertex in vase.data.vertices:
        vertex.select = vertex.index > 35
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.heritage.split_object(name="Cup")
    bpy.ops.object.mode_set(mode="OBJECT")
    store()


def merge(_: StandIn) -> None:
    listed("Vase")
    bpy.ops.heritage.merge_objects(names="Cup")
    store()


def delete_in_list(_: StandIn) -> None:
    listed("Cup")
    bpy.ops.heritage.delete_object()
    store()


def delete_by_key(_: StandIn) -> None:
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.name == "Cup")
    bpy.ops.object.delete()
    store()


def raise_threshold(_: StandIn) -> None:
    isolated()["vase"].heritage.threshold = 0.8
    store()


ACTIONS = [
    isolate, correct, find_all, rename, rename_collection, rename_to_a_name_in_use, rename_to_what_projects_change,
    take_by_hand, split, merge, delete_in_list, delete_by_key, raise_threshold,
]  # fmt: skip


@pytest.fixture
def act(installed: str, fake_engine: StandIn) -> Callable[[Callable[[StandIn], None]], None]:
    """Return a function that does what a user does, with the real engine for what is stored by hand."""

    def do(action: Callable[[StandIn], None]) -> None:
        bpy.context.preferences.addons[installed].preferences.engine_python = os.environ["GAUSSIAN_HERITAGE_PYTHON"]
        action(fake_engine)
        step()

    return do


Act = Callable[[Callable[[StandIn], None]], None]


@pytest.mark.parametrize("action", ACTIONS)
def test_blender_project_and_files_agree_all_life_long(
    action: Callable[[StandIn], None], museum: Any, act: Act, part: Part, tmp_path: Path
) -> None:
    before = in_blender(part)

    def agree() -> Shown:
        shown = in_blender(part)
        assert in_project(part, museum.folder) == shown and in_files(part, tmp_path / "out") == shown
        return shown

    assert agree() == {"Vase": 25, "Cup": 20} == before
    act(action)
    created = agree()
    assert created != before
    # The steps of an edit that was not stored yet.
    while in_blender(part) != before:
        undo()
    assert agree() == before and problem(part) == ""
    for _ in range(4):
        if in_blender(part) == created and in_project(part, museum.folder) == created:
            break
        redo()
    assert agree() == created and problem(part) == ""

    home = tmp_path / "home"
    home.mkdir()
    file = home / "museum.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    assert agree() == created, "saved"
    bpy.ops.wm.open_mainfile(filepath=str(file))
    assert agree() == created, "reopened"
    bpy.ops.heritage.open_project(directory=str(museum.folder))
    assert agree() == created, "opened again"
    shutil.move(museum.folder, home / museum.folder.name)
    shutil.move(home, tmp_path / "new home")
    museum.folder = tmp_path / "new home" / museum.folder.name
    file = tmp_path / "new home" / "museum.blend"
    bpy.ops.wm.open_mainfile(filepath=str(file))
    assert agree() == created, "moved"
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(file)) as (source, target):
        target.collections = [name for name in source.collections if name in created]
    for collection in target.collections:
        bpy.context.scene.collection.children.link(collection)
    assert agree() == created, "appended"
