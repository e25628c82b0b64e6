from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.core.errors import DiskError, FormatError, ObjectError
from engine.pictures import encode_png
from engine.project.objects import (
    ObjectRecord,
    is_object_intact,
    list_objects,
    load_levels,
    load_membership,
    load_object,
    new_id,
    new_name,
    object_gaussians,
    save_object,
    taken_ids,
    write_record,
)
from engine.scene import Detailed, Gaussians

RECORD = ObjectRecord(
    id="vase",
    name="Vase",
    prompt={"kind": "text", "text": "vase"},
    threshold=0.5,
    score=0.8,
    fit=0.9,
    n_gaussians=2,
    n_scene_gaussians=3,
    evidence=({"photo": "a.jpg", "score": 0.8},),
    created="2026-01-01T00:00:00+00:00",
)
MEMBERSHIP = np.array([0.1, 0.7, 1.0], np.float32)


def test_object_comes_back_as_it_was(tmp_path: Path) -> None:
    save_object(tmp_path, RECORD, MEMBERSHIP, pictures={"evidence.png": encode_png(np.zeros((4, 5), np.uint8))})
    assert list_objects(tmp_path) == [RECORD]
    np.testing.assert_array_equal(load_membership(tmp_path, "vase"), MEMBERSHIP)
    assert sorted(p.name for p in (tmp_path / "objects" / "vase").iterdir()) == [
        "evidence.png",
        "membership.npy",
        "object.json",
    ]


def test_object_is_found_by_id_and_by_name_in_any_case(tmp_path: Path) -> None:
    save_object(tmp_path, replace(RECORD, id="vase-2", name="Vase / left"), MEMBERSHIP)
    for name in ("vase-2", "Vase / left", "vase / LEFT"):
        assert load_object(tmp_path, name).id == "vase-2"


def test_unknown_object_lists_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(ObjectError, match="no objects yet"):
        load_object(tmp_path, "vase")
    save_object(tmp_path, RECORD, MEMBERSHIP)
    with pytest.raises(ObjectError, match=r"Did you mean 'Vase'\? Known: Vase"):
        load_object(tmp_path, "Vasse")
    with pytest.raises(ObjectError, match="missing"):
        load_membership(tmp_path, "bowl")


def test_half_written_object_is_not_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(DiskError, match="No space left"):
        save_object(tmp_path, RECORD, MEMBERSHIP)
    assert list_objects(tmp_path) == []
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def save_whole(project: Path) -> Path:
    """Save an object with every file that an object can have, and return its folder."""
    levels = (MEMBERSHIP, np.ones(3, np.float32))
    record = replace(RECORD, levels=({"n_gaussians": 2}, {"n_gaussians": 3}))
    gaussians = Gaussians(
        *(np.ones(shape, np.float32) for shape in ((2, 3), (2, 3), (2, 4), (2,), (2, 1, 3))), features=None
    )
    detailed = Detailed(np.array([1, 2], np.int32), gaussians.means, np.array([1, 2], np.int32), gaussians)
    save_object(project, record, MEMBERSHIP, levels=levels, detailed=detailed)
    return project / "objects" / "vase"


READERS = {
    "membership.npy": lambda project, record: load_membership(project, "vase"),
    "levels.npy": lambda project, record: load_levels(project, "vase"),
    "detail.npz": lambda project, record: object_gaussians(
        project, record, Gaussians(*(np.ones(s, np.float32) for s in ((3, 3), (3, 3), (3, 4), (3,), (3, 1, 3))), None)
    ),
}


@pytest.mark.parametrize("damage", ["cut", "one bit", "gone"])
@pytest.mark.parametrize("name", READERS)
def test_damaged_file_of_an_object_is_named(name: str, damage: str, tmp_path: Path) -> None:
    folder = save_whole(tmp_path)
    (record,) = list_objects(tmp_path)
    READERS[name](tmp_path, record)
    assert is_object_intact(tmp_path, "vase")
    content = bytearray((folder / name).read_bytes())
    content[-20] ^= 1
    if damage == "gone":
        (folder / name).unlink()
    else:
        (folder / name).write_bytes(bytes(content) if damage == "one bit" else bytes(content[: len(content) // 2]))
    problem = "is missing" if damage == "gone" else "was damaged"
    with pytest.raises(FormatError, match=rf"{name} {problem}\. Isolate the object again"):
        READERS[name](tmp_path, record)
    assert not is_object_intact(tmp_path, "vase")


def test_title_and_new_name_are_no_damage(tmp_path: Path) -> None:
    folder = save_whole(tmp_path)
    (folder / "record.json").write_text("{}")
    data = json.loads((folder / "object.json").read_text())
    (folder / "object.json").write_text(json.dumps({**data, "name": "Krater"}))
    assert is_object_intact(tmp_path, "vase")
    assert [record.name for record in list_objects(tmp_path)] == ["Krater"]
    save_object(tmp_path, RECORD, MEMBERSHIP)
    assert sorted(path.name for path in folder.iterdir()) == ["membership.npy", "object.json", "record.json"]


def test_damaged_records_and_values_are_named(tmp_path: Path) -> None:
    save_object(tmp_path, RECORD, MEMBERSHIP)
    folder = tmp_path / "objects" / "vase"
    # Without its hash, so that the reader of the file is reached.
    write_record(folder / "object.json", RECORD, {})
    (folder / "membership.npy").write_bytes(b"\x93NUMPY broken")
    with pytest.raises(FormatError, match=r"membership\.npy cannot be read"):
        load_membership(tmp_path, "vase")
    np.save(folder / "membership.npy", np.array([0.5, np.nan], np.float32))
    with pytest.raises(FormatError, match="finite"):
        load_membership(tmp_path, "vase")
    for text in ("{", "[]", "[" * 5000, '{"version": 1}', '{"version": 99}', '{"version": 1, "name": 3}'):
        (folder / "object.json").write_text(text)
        with pytest.raises(FormatError, match=r"object\.json"):
            list_objects(tmp_path)
        assert not is_object_intact(tmp_path, "vase")


def test_object_is_not_stored_where_the_user_left_something(tmp_path: Path) -> None:
    (tmp_path / "objects" / "vase").mkdir(parents=True)
    assert taken_ids(tmp_path) == []
    (tmp_path / "objects" / "vase" / "record.json").write_text("{}")
    assert new_id("Vase", taken_ids(tmp_path)) == "vase-2"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Vase", "vase"),
        ("Vase / links", "vase-links"),
        ("../../etc", "etc"),
        ("Ваза №1", "ваза-no1"),
        ("花瓶", "花瓶"),
        ("///", "object"),
        ("", "object"),
        ("CON", "object-con"),
    ],
)
def test_ids_are_safe_folder_names(name: str, expected: str) -> None:
    assert new_id(name, []) == expected


def test_equal_names_get_a_number() -> None:
    assert new_id("vase", ["vase", "vase-2"]) == "vase-3"
    assert new_id("Vase!", ["vase"]) == "vase-2"
    assert new_name("Vase  left", []) == "Vase left"
    assert new_name("Vase", ["Vase"]) == "Vase-2"


@settings(deadline=None)  # a busy machine is no fault
@given(st.text(max_size=300))
def test_any_name_makes_a_folder_inside_of_objects(name: str) -> None:
    identity = new_id(name, [])
    assert identity and "/" not in identity and "\\" not in identity and identity not in (".", "..")
    assert len(identity.encode()) <= 255 and identity == new_id(identity, [])
