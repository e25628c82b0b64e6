"""What a user made is in the trash after it was deleted or replaced, and comes back from there."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import DiskError, ObjectError
from engine.project.folder import ProjectFolder
from engine.project.objects import (
    bring_back,
    delete_object,
    discard_object,
    empty_trash,
    keep_version,
    list_objects,
    list_trash,
    load_membership,
    object_states,
    rename_object,
    restore_object,
    save_object,
)
from tests.engine.project.test_objects import MEMBERSHIP, RECORD


@pytest.fixture
def project(tmp_path: Path) -> ProjectFolder:
    made = ProjectFolder.create(tmp_path / "project")
    save_object(made.path, RECORD, MEMBERSHIP)
    (made.path / "objects" / "vase" / "record.json").write_text('{"title": "Krater"}')
    return made


def scene(project: ProjectFolder, content: bytes) -> None:
    """Train, as far as the record is concerned."""
    file = project.path / "gaussians" / "scene.ply"
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(content)
    project.finish_stage("training", "key", wall_seconds=1, cpu_seconds=1, figures={}, outputs=[file])


def test_deleted_object_comes_back_as_it_was(project: ProjectFolder) -> None:
    before = {path.name: path.read_bytes() for path in (project.path / "objects" / "vase").iterdir()}
    assert delete_object(project, "Vase", why="deleted") == RECORD
    assert list_objects(project.path) == [] and not (project.path / "objects" / "vase").exists()
    (entry,) = list_trash(project.path)
    assert (entry.id, entry.name, entry.why) == ("vase", "Vase", "deleted")
    assert entry.n_bytes > 500
    assert restore_object(project, "1") == RECORD
    assert {path.name: path.read_bytes() for path in (project.path / "objects" / "vase").iterdir()} == before
    assert list_trash(project.path) == [] and list((project.path / "trash").iterdir()) == []


@pytest.mark.parametrize("which", ["1", "Vase", "vase"])
def test_restoring_replaces_nothing(which: str, project: ProjectFolder) -> None:
    delete_object(project, "vase", why="deleted")
    other = np.zeros(3, np.float32)
    save_object(project.path, RECORD, other)
    restored = restore_object(project, which)
    assert (restored.id, restored.name) == ("vase-2", "Vase-2")
    assert {record.id: record.name for record in list_objects(project.path)} == {"vase": "Vase", "vase-2": "Vase-2"}
    np.testing.assert_array_equal(load_membership(project.path, "vase"), other)
    np.testing.assert_array_equal(load_membership(project.path, "vase-2"), MEMBERSHIP)


def test_last_deleted_of_several_with_one_name_is_restored(project: ProjectFolder) -> None:
    for value in (0.25, 0.75):
        save_object(project.path, RECORD, np.full(3, value, np.float32))
        delete_object(project, "vase", why="deleted")
    restore_object(project, "Vase")
    np.testing.assert_array_equal(load_membership(project.path, "vase"), np.full(3, 0.75, np.float32))


def test_earlier_version_of_a_changed_object_is_kept_with_what_the_user_wrote(project: ProjectFolder) -> None:
    keep_version(project, "vase", why="corrected")
    save_object(project.path, RECORD, np.zeros(3, np.float32))
    assert restore_object(project, "vase").id == "vase-2"
    np.testing.assert_array_equal(load_membership(project.path, "vase-2"), MEMBERSHIP)
    for name in ("vase", "vase-2"):
        assert "Krater" in (project.path / "objects" / name / "record.json").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["../precious", "bowl", "", "..", "_candidates"])
def test_only_what_the_project_lists_can_be_moved(name: str, project: ProjectFolder) -> None:
    (project.path / "objects" / "_candidates").mkdir()
    (project.path.parent / "precious").mkdir()
    before = sorted(project.path.parent.rglob("*"))
    for function in (delete_object, discard_object, keep_version):
        with pytest.raises(ObjectError):
            function(project, name, why="deleted")
    assert sorted(project.path.parent.rglob("*")) == before


def test_object_whose_record_is_damaged_can_be_moved_to_the_trash(project: ProjectFolder) -> None:
    (project.path / "objects" / "vase" / "object.json").write_text("{half")
    discard_object(project, "vase", why="damaged")
    assert list_objects(project.path) == []
    assert [entry.name for entry in list_trash(project.path)] == ["vase"]


@pytest.mark.parametrize("change", [delete_object, keep_version])
def test_kill_before_the_move_leaves_the_object_in_its_place(
    change: object, project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.replace

    def fails(source: Path, target: Path) -> None:
        if target.name == "object":
            raise OSError(5, "Input/output error")
        real(source, target)

    with monkeypatch.context() as patch, pytest.raises(DiskError, match="Could not move"):
        patch.setattr(os, "replace", fails)
        change(project, "vase", why="deleted")  # type: ignore[operator]
    assert list_objects(project.path) == [RECORD] and list_trash(project.path) == []
    assert empty_trash(project) == (0, 0)
    assert list((project.path / "trash").iterdir()) == []


def test_object_of_another_training_is_not_restored_and_its_files_stay(project: ProjectFolder) -> None:
    scene(project, b"first")
    delete_object(project, "vase", why="of an earlier training")
    scene(project, b"second")
    with pytest.raises(ObjectError, match="belongs to an earlier training .* Its files stay in"):
        restore_object(project, "vase")
    scene(project, b"first")
    assert restore_object(project, "vase") == RECORD


def test_emptying_deletes_what_is_old_enough(project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    delete_object(project, "vase", why="deleted")
    (entry,) = list_trash(project.path)
    assert datetime.now(UTC) - entry.deleted < timedelta(minutes=5)
    assert empty_trash(project, older_than_days=1) == (0, 0)
    assert empty_trash(project) == (1, entry.n_bytes)
    assert list_trash(project.path) == [] and list((project.path / "trash").iterdir()) == []


@pytest.mark.parametrize("text", ["{half", "[]", '{"version": 1, "id": "../..", "name": 3}', ""])
def test_damaged_note_does_not_hide_the_object(text: str, project: ProjectFolder) -> None:
    delete_object(project, "vase", why="deleted")
    (entry,) = list_trash(project.path)
    (entry.folder / "trash.json").write_text(text)
    (again,) = list_trash(project.path)
    assert "damaged" in again.why
    restored = restore_object(project, "1")
    assert restored == replace(RECORD, id=restored.id)


def test_note_cannot_restore_an_object_to_a_place_outside(project: ProjectFolder) -> None:
    delete_object(project, "vase", why="deleted")
    (entry,) = list_trash(project.path)
    note = (entry.folder / "trash.json").read_text(encoding="utf-8").replace('"vase"', '"../../../precious"')
    (entry.folder / "trash.json").write_text(note)
    assert restore_object(project, "1").id == "precious"
    assert [record.id for record in list_objects(project.path)] == ["precious"]
    assert not list(project.path.parent.glob("precious*"))


def test_earlier_state_comes_back_and_forth_under_the_present_name_and_record(project: ProjectFolder) -> None:
    record_file = project.path / "objects" / "vase" / "record.json"
    first = object_states(project.path)["vase"]
    keep_version(project, "vase", why="corrected")
    other = np.array([0, 0, 1], np.float32)
    save_object(project.path, RECORD, other)
    second = object_states(project.path)["vase"]
    rename_object(project.path, "vase", "Urn")
    record_file.write_text('{"title": "Urn"}')
    assert object_states(project.path)["vase"] == second != first, "the name is no part of the state"
    for state, membership in ((first, MEMBERSHIP), (second, other), (first, MEMBERSHIP)):
        bring_back(project, "vase", state, why="undone in Blender")
        assert object_states(project.path) == {"vase": state}
        np.testing.assert_array_equal(load_membership(project.path, "vase"), membership)
        assert [record.name for record in list_objects(project.path)] == ["Urn"]
        assert record_file.read_text(encoding="utf-8") == '{"title": "Urn"}'
        assert len(list_trash(project.path)) == 1, "the trash does not grow"
    discard_object(project, "vase", why="undone in Blender")
    assert object_states(project.path) == {}
    bring_back(project, "vase", first, why="")
    assert object_states(project.path) == {"vase": first}
    empty_trash(project)
    with pytest.raises(ObjectError, match="no earlier state of 'vase' any more"):
        bring_back(project, "vase", second, why="")
    assert object_states(project.path) == {"vase": first}
