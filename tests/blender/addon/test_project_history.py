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
from conftest import Part, StandIn, isolated, write_object

Shown = dict[str, int]
"""Gaussians of each object, by name."""

ENGINE = """
import os
sys.path.insert(0, os.environ["PYTHONPATH"])
from engine.project.folder import ProjectFolder
from engine.project.objects import delete_object, keep_version
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
    if bpy.ops.ed.undo.poll():  # false at the first step
        bpy.ops.ed.undo()
    bpy.context.view_layer.update()


def redo() -> None:
    bpy.ops.ed.redo()
    bpy.context.view_layer.update()


def in_blender(part: Part) -> Shown:
    """Return what Blender shows. An object, its own collection and its row in the list have the same name."""
    rows = part("gaussian_heritage_addon.project.hand_edits").member_rows
    found = {}
    for obj in bpy.context.scene.objects:
        if obj.heritage.role == "OBJECT":
            assert obj.name in [collection.name for collection in obj.users_collection], obj.name
            found[obj.name] = len(rows(obj))
    return found


def in_project(part: Part, folder: Path) -> Shown:
    """Return what the project has: the record and the stored memberships agree."""
    content, objects, found = part("engine.project.content"), part("engine.project.objects"), {}
    for item in content.shown_objects(folder):
        objects.require_intact(folder, item.id)
        members = objects.load_membership(folder, item.id, 100) >= np.float32(item.threshold)
        assert members.sum() == item.n_gaussians, item
        found[item.name] = item.n_gaussians
    return found


def in_files(part: Part, folder: Path) -> Shown:
    shutil.rmtree(folder, ignore_errors=True)
    if not isolated():
        return {}
    assert bpy.ops.heritage.export_objects(directory=str(folder), scope="ALL", format="PLY", with_background=True) == {
        "FINISHED"
    }
    return {file.stem: len(part("engine.formats").read_ply(file)) for file in folder.glob("*.ply")}


def problem(part: Part) -> str:
    return str(part("gaussian_heritage_addon.blender.problems").shown())


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


@pytest.mark.slow
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


def names(part: Part, folder: Path) -> dict[str, str]:
    return {item.id: item.name for item in part("engine.project.content").shown_objects(folder)}


def not_stored(draw: Callable[[str], Any]) -> list[str]:
    """Return what the panel says of differences between Blender and the project."""
    words = ("Not stored", "Deleted, not", "Only in")
    return [text for text in draw("HERITAGE_PT_objects").texts if text.startswith(words)]


def write(part: Part, folder: Path, object_id: str, name: str) -> None:
    """Rename an object as another program does."""
    part("engine.project.objects").rename_object(folder, object_id, name)


def test_collection_follows_the_undo_of_a_name_that_was_given_in_the_list(museum: Any, part: Part) -> None:
    before = in_blender(part)
    vase = isolated()["vase"]
    vase.name = "Urn"
    step()
    assert "Urn" in in_blender(part) and names(part, museum.folder)["vase"] == "Urn"
    # Undo in a window, where the step ends before the collection follows, gives back what belongs to the object alone.
    vase.name = vase.heritage_state.object_name = vase.heritage_state.shown_name = "Vase"
    part("gaussian_heritage_addon.project.project_history").catch_up()
    assert in_blender(part) == before and names(part, museum.folder)["vase"] == "Vase"


def test_hidden_object_is_renamed_as_well(museum: Any, part: Part) -> None:
    bpy.context.scene.heritage.show = "SCENE"
    step()
    isolated()["vase"].name = "Urn"
    step()
    assert names(part, museum.folder)["vase"] == "Urn" and "Urn" in bpy.data.collections
    undo()
    assert names(part, museum.folder)["vase"] == "Vase" and "Vase" in bpy.data.collections


def test_record_follows_undo_and_redo(museum: Any, part: Part) -> None:
    load = part("engine.project.objects").load_record
    for title in ("Krater", "Amphora"):
        isolated()["vase"].heritage.title = title
        step()
    undo()
    assert load(museum.folder, "vase").title == isolated()["vase"].heritage.title == "Krater"
    undo()
    assert load(museum.folder, "vase").title == isolated()["vase"].heritage.title == ""
    redo()
    redo()
    assert load(museum.folder, "vase").title == isolated()["vase"].heritage.title == "Amphora"


def test_fields_that_another_program_has_filled_in_are_kept(museum: Any, part: Part) -> None:
    records = part("engine.project.objects")
    records.save_record(museum.folder, "vase", records.MuseumRecord(notes="from the page"))
    vase = isolated()["vase"]
    vase.heritage.title = "Krater"
    assert records.load_record(museum.folder, "vase") == records.MuseumRecord(title="Krater", notes="from the page")
    assert vase.heritage.notes == "from the page"


@pytest.mark.parametrize("action", [isolate, correct, rename])
def test_what_another_program_stored_since_is_kept_and_said(
    action: Callable[[StandIn], None], museum: Any, act: Act, part: Part, draw: Callable[[str], Any]
) -> None:
    act(action)
    step()
    object_id = "pot" if action is isolate else "vase"
    if action is rename:
        write(part, museum.folder, object_id, "Theirs")
    else:
        theirs = np.r_[np.zeros(90), np.ones(10)].astype(np.float32)
        write_object(museum.folder, object_id, "Vase" if action is correct else "Tea Pot", theirs)
    kept = in_project(part, museum.folder)
    for _ in range(3):
        undo()
    assert in_project(part, museum.folder) == kept
    assert "was changed by another program since, and stays so there" in problem(part)
    part("gaussian_heritage_addon.project.project_history").look_again()
    assert not_stored(draw) == (["Only in the project: Tea Pot"] if action is isolate else ["Not stored: Vase"])
    bpy.ops.heritage.open_project(directory=str(museum.folder))
    assert in_blender(part) == in_project(part, museum.folder) == kept and not_stored(draw) == []


def test_undo_of_opening_a_project_deletes_nothing_in_it(museum: Any, part: Part) -> None:
    write_object(museum.folder, "lid", "Lid", np.r_[np.zeros(95), np.ones(5)].astype(np.float32))
    stored = in_project(part, museum.folder)
    bpy.ops.heritage.open_project(directory=str(museum.folder))
    step()
    for _ in range(4):
        undo()
        assert in_project(part, museum.folder) == stored and problem(part) == ""


def test_project_in_which_a_job_works_follows_when_that_has_ended(museum: Any, act: Act, part: Part) -> None:
    act(isolate)
    stored = in_project(part, museum.folder)
    history = part("gaussian_heritage_addon.project.project_history")
    with part("engine.project.folder").ProjectFolder.open_existing(museum.folder):
        undo()
        isolated()["vase"].name = "Urn"
        bpy.context.view_layer.update()
        assert in_project(part, museum.folder) == stored and problem(part) == ""
    history.catch_up()
    assert in_project(part, museum.folder) == in_blender(part) == {"Urn": 25, "Cup": 20}


@pytest.mark.parametrize("action", [isolate, correct, rename, take_by_hand, delete_by_key])
def test_killed_between_undo_and_storing_it_says_so_and_one_press_stores(
    action: Callable[[StandIn], None],
    museum: Any,
    act: Act,
    part: Part,
    draw: Callable[[str], Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = in_blender(part)
    act(action)
    stored = in_project(part, museum.folder)
    with monkeypatch.context() as killed:
        killed.setattr(part("gaussian_heritage_addon.project.project_history"), "_follow_objects", lambda project: [])
        while in_blender(part) != before:
            undo()
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert in_project(part, museum.folder) == stored != before, "opening a file writes nothing"
    (said,) = not_stored(draw)
    if action is isolate:
        # Whether it was undone here or is new there, nobody knows any more: nothing is deleted.
        assert said == "Only in the project: Tea Pot"
        return
    assert said == f"Not stored: {'Cup' if action is delete_by_key else 'Vase'}"
    assert bpy.ops.heritage.store_edits() == {"FINISHED"}
    assert in_project(part, museum.folder) == in_blender(part) == before and not_stored(draw) == []


def test_state_that_the_trash_has_not_any_more_is_said_and_stored_by_one_press(
    museum: Any, act: Act, part: Part, draw: Callable[[str], Any]
) -> None:
    act(correct)
    folders = part("engine.project.folder").ProjectFolder
    with folders.open_existing(museum.folder) as opened:
        part("engine.project.objects").empty_trash(opened)
    undo()
    assert "no earlier state of 'vase' any more" in problem(part) and not_stored(draw) == ["Not stored: Vase"]
    act(lambda _: bpy.ops.heritage.store_edits())
    assert in_project(part, museum.folder) == in_blender(part) == {"Vase": 25, "Cup": 20} and not_stored(draw) == []


def test_project_that_cannot_be_written_is_said_once_and_marked(
    museum: Any, part: Part, draw: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    history, errors = part("gaussian_heritage_addon.project.project_history"), part("engine.core.errors")

    def refuse(*_: Any) -> None:
        raise errors.DiskError("The disk is read-only.")

    with monkeypatch.context() as read_only:
        read_only.setattr(history, "rename_object", refuse)
        isolated()["vase"].name = "Urn"
        bpy.context.view_layer.update()
    assert problem(part) == "The disk is read-only." and not_stored(draw) == ["Not stored: Urn"]
    part("gaussian_heritage_addon.blender.problems").clear()
    history.catch_up()
    assert problem(part) == "" and names(part, museum.folder)["vase"] == "Vase"


def test_copies_belong_to_the_file_alone(
    museum: Any, act: Act, part: Part, draw: Callable[[str], Any], tmp_path: Path
) -> None:
    vase, stored = isolated()["vase"], in_project(part, museum.folder)
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj == vase)
    bpy.ops.object.duplicate()
    step()
    (copy,) = [obj for obj in bpy.context.scene.objects if obj.heritage.object_id == "vase" and obj != vase]
    copy.name = "My Copy"
    copy.heritage.title = "Copy"
    bpy.context.view_layer.update()
    assert "is a copy" in copy.heritage.problem and vase.name == "Vase" and not_stored(draw) == []
    bpy.data.objects.remove(copy)
    step()
    assert in_project(part, museum.folder) == stored and not_stored(draw) == []
    assert part("engine.project.objects").load_record(museum.folder, "vase").title == ""
    file = tmp_path / "museum.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.append(filename="Vase", directory=f"{file}/Collection/")
    appended = bpy.data.objects["Vase"]
    step()
    appended.name = "Elsewhere"
    appended.heritage.title = "Elsewhere"
    step()
    bpy.data.objects.remove(appended)
    step()
    assert in_project(part, museum.folder) == stored
    assert part("engine.project.objects").load_record(museum.folder, "vase").title == ""


def test_object_that_another_scene_of_the_file_shows_is_not_deleted(
    museum: Any, part: Part, draw: Callable[[str], Any]
) -> None:
    bpy.ops.scene.new(type="FULL_COPY")
    step()
    copies = [obj for obj in bpy.context.scene.objects if obj.heritage.role == "OBJECT"]
    assert len(copies) == 2
    for obj in copies:
        bpy.data.objects.remove(obj)
    step()
    assert not_stored(draw) == []
    first, second = bpy.data.scenes["Scene"], bpy.context.scene
    bpy.context.window.scene = first
    bpy.data.scenes.remove(second)
    isolated()["vase"].name = "Urn"
    step()
    assert names(part, museum.folder)["vase"] == "Urn"


def test_copy_takes_over_when_the_scene_of_the_original_is_deleted(
    museum: Any, part: Part, draw: Callable[[str], Any]
) -> None:
    first = bpy.context.scene
    bpy.ops.scene.new(type="FULL_COPY")
    step()
    for obj in [obj for obj in first.objects if obj.heritage.role == "OBJECT"]:
        bpy.data.objects.remove(obj)
    bpy.data.scenes.remove(first)
    step()
    assert not [text for text in not_stored(draw) if text.startswith("Deleted")]
    isolated()["vase"].name = "Urn"
    step()
    assert names(part, museum.folder)["vase"] == "Urn"


def test_name_that_another_project_has_in_the_same_file_stays_in_both(
    museum: Any, part: Part, draw: Callable[[str], Any], tmp_path: Path
) -> None:
    other = tmp_path / "other_heritage"
    shutil.copytree(museum.folder, other)
    bpy.ops.heritage.open_project(directory=str(other))
    step()
    assert [names(part, one)["vase"] for one in (museum.folder, other)] == ["Vase", "Vase"]
    assert not_stored(draw) == []
    for scene in bpy.data.scenes:
        for obj in scene.objects:
            if obj.heritage.object_id == "cup" and scene == bpy.context.scene:
                obj.name = "Vase"
    step()
    assert names(part, museum.folder) == {"vase": "Vase", "cup": "Cup"}
    assert names(part, other) == {"vase": "Vase", "cup": "Vase-2"} and not_stored(draw) == []


def test_object_deleted_by_a_key_does_not_come_back_by_finding_all(
    museum: Any, act: Act, part: Part, draw: Callable[[str], Any]
) -> None:
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.name == "Cup")
    bpy.ops.object.delete()
    step()
    assert not_stored(draw) == ["Deleted, not stored: Cup"]
    act(find_all)
    assert "Cup" not in in_blender(part) and not_stored(draw) == ["Deleted, not stored: Cup"]
    act(lambda _: bpy.ops.heritage.store_edits())
    assert in_project(part, museum.folder) == in_blender(part) and not_stored(draw) == []
