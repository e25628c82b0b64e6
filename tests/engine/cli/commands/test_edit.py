"""`edit`: edits by hand replace memberships, and nothing that a user had is lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.project.objects import (
    ObjectRecord,
    list_objects,
    list_trash,
    load_membership,
    load_object,
    object_gaussians,
    object_states,
    save_object,
)
from engine.scene import load_detailed
from engine.scene.detailed import Detailed
from tests.engine.command_line import call
from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene


@pytest.fixture
def scene(blobs: BlobScene, tmp_path: Path) -> Path:
    """A project with the objects red, twin and blue; blue is detailed and has two levels."""
    project = trained_project(blobs, tmp_path).path
    for part, name in ((RED, "red"), (TWIN, "twin")):
        save_object(project, record_of(name, blobs), of_part(blobs, part))
    rows = np.flatnonzero(blobs.part == BLUE).astype(np.int32)
    trained = replace(blobs.gaussians[rows], features=None)
    detailed = Detailed(rows, trained.means, rows, replace(trained, opacity_logits=trained.opacity_logits - 1))
    levels = ({"n_gaussians": 10}, {"n_gaussians": len(rows)})
    blue = of_part(blobs, BLUE)
    record = replace(record_of("blue", blobs), level=1, levels=levels)
    save_object(project, record, blue, levels=[blue * 0.9, blue], detailed=detailed)
    return project


def record_of(name: str, blobs: BlobScene) -> ObjectRecord:
    return ObjectRecord(name, name.title(), {"kind": "click"}, 0.5, 1.0, 1.0, 150, len(blobs.part))


def of_part(blobs: BlobScene, part: int) -> np.ndarray:
    return (blobs.part == part).astype(np.float32)


def test_membership_is_replaced_and_the_earlier_object_is_in_the_trash(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = of_part(blobs, BLUE)
    kept, added = np.flatnonzero(new)[10:], np.flatnonzero(blobs.part == RED)[:5]
    new[:] = 0
    new[kept] = new[added] = 1
    file = tmp_path / "new =.npy"
    np.save(file, new)
    assert call(capsys, "edit", scene, "--set", f"blue={file}").code == 0
    record = load_object(scene, "blue")
    assert (record.n_gaussians, record.name, record.levels) == (len(kept) + 5, "Blue", ())
    assert np.array_equal(load_membership(scene, "blue"), new)
    detailed = load_detailed(scene, "blue")
    assert detailed is not None and np.array_equal(detailed.rows, kept)
    exported = object_gaussians(scene, record, replace(blobs.gaussians, features=None))
    assert len(exported) == record.n_gaussians
    assert [entry.why for entry in list_trash(scene)] == ["edited by hand"]


def test_new_object_name_merge_and_deletion(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    floor = tmp_path / "floor.npy"
    np.save(floor, of_part(blobs, 0))
    blue = object_states(scene)["blue"]
    answer = call(capsys, "edit", scene, "--set", f"böden={floor}", "--rename", "böden=Böden", "--delete", "blue")
    outputs = answer.of_kind("finished")[0]["outputs"]
    assert (outputs["objects"], outputs["deleted"]) == (["böden"], ["blue"])
    assert outputs["deleted_states"] == [blue]
    assert load_object(scene, "Böden").prompt == {"kind": "hand"}
    assert call(capsys, "edit", scene, "--merge", "red=twin").code == 0
    assert np.array_equal(load_membership(scene, "red"), np.isin(blobs.part, (RED, TWIN)))
    assert sorted(record.id for record in list_objects(scene)) == ["böden", "red"]
    assert sorted(entry.id for entry in list_trash(scene)) == ["blue", "red", "twin"]
    assert call(capsys, "trash", "restore", scene, "twin").code == 0
    assert np.array_equal(load_membership(scene, "twin"), of_part(blobs, TWIN))


def test_threshold_and_level_that_are_shown_are_stored(
    scene: Path, blobs: BlobScene, capsys: pytest.CaptureFixture[str]
) -> None:
    graded = np.where(blobs.part == RED, np.float32(0.6), np.float32(0))
    graded[np.flatnonzero(blobs.part == RED)[:5]] = 0.9
    save_object(scene, record_of("red", blobs), graded)
    assert call(capsys, "edit", scene, "--threshold", "red=0.8", "--level", "blue=0").code == 0
    red, blue = load_object(scene, "red"), load_object(scene, "blue")
    assert (red.threshold, red.n_gaussians) == (0.8, 5)
    assert len(object_gaussians(scene, red, replace(blobs.gaussians, features=None))) == 5
    assert (blue.level, len(blue.levels)) == (0, 2)
    assert blue.n_gaussians == len(object_gaussians(scene, blue, replace(blobs.gaussians, features=None)))
    assert sorted(entry.why for entry in list_trash(scene)) == ["shown otherwise", "shown otherwise"]


def test_no_two_objects_get_the_same_name(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    red = load_object(scene, "red")
    assert call(capsys, "edit", scene, "--rename", "twin= red   vase ", "--rename", f"blue={red.name}").code == 0
    names = {record.id: record.name for record in list_objects(scene)}
    assert names == {"red": red.name, "twin": "red vase", "blue": f"{red.name}-2"}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "at least one of"),
        (("--set", "red"), "two parts"),
        (("--set", "red=short.npy"), "has 3 values"),
        (("--set", "red=large.npy"), "from 0 to 1"),
        (("--set", "red=empty.npy"), "Nothing would be left"),
        (("--set", "../x=full.npy"), "cannot have the id"),
        (("--set", "red=missing.npy"), "missing.npy"),
        (("--merge", "red=red"), "two different objects"),
        (("--merge", "red=vase"), "No object is called 'vase'"),
        (("--rename", "vase=Vase"), "no object with the id 'vase'"),
        (("--threshold", "red=1.5"), "must be from 0 to 1"),
        (("--threshold", "red=high"), "an id and a number"),
        (("--threshold", "vase=0.5"), "no object with the id 'vase'"),
        (("--level", "red=1"), "has no level 1"),
        (("--delete", "red", "--delete", "vase"), "no object with the id 'vase'"),
    ],
)
def test_what_cannot_be_stored_is_one_sentence_and_changes_nothing(
    words: tuple[str, ...],
    sentence: str,
    scene: Path,
    blobs: BlobScene,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    count = len(blobs.part)
    for name, values in (("short", np.ones(3)), ("large", np.full(count, 2.0)), ("empty", np.zeros(count))):
        np.save(tmp_path / f"{name}.npy", values.astype(np.float32))
    np.save(tmp_path / "full.npy", np.ones(count, np.float32))
    monkeypatch.chdir(tmp_path)
    assert sentence in call(capsys, "edit", scene, *words).error
    assert len(list_objects(scene)) == 3 and not list_trash(scene)
