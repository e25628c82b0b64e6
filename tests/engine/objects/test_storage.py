from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.errors import DiskError, FormatError, ObjectError
from engine.objects.storage import (
    ObjectRecord,
    delete_object,
    list_objects,
    load_membership,
    load_object,
    new_id,
    new_name,
    save_object,
)

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
    save_object(tmp_path, RECORD, MEMBERSHIP, [("seed", np.zeros((4, 5), np.uint8))])
    assert list_objects(tmp_path) == [RECORD]
    np.testing.assert_array_equal(load_membership(tmp_path, "vase"), MEMBERSHIP)
    assert sorted(p.name for p in (tmp_path / "objects" / "vase").iterdir()) == [
        "membership.npy",
        "object.json",
        "seed.png",
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


def test_removed_object_is_gone(tmp_path: Path) -> None:
    save_object(tmp_path, RECORD, MEMBERSHIP)
    assert delete_object(tmp_path, "Vase") == RECORD
    assert list_objects(tmp_path) == [] and not (tmp_path / "objects" / "vase").exists()


def test_half_written_object_is_not_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(DiskError, match="No space left"):
        save_object(tmp_path, RECORD, MEMBERSHIP)
    assert list_objects(tmp_path) == []
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_damaged_files_are_named(tmp_path: Path) -> None:
    save_object(tmp_path, RECORD, MEMBERSHIP)
    folder = tmp_path / "objects" / "vase"
    (folder / "membership.npy").write_bytes(b"\x93NUMPY broken")
    with pytest.raises(FormatError, match=r"membership\.npy cannot be read"):
        load_membership(tmp_path, "vase")
    np.save(folder / "membership.npy", np.array([0.5, np.nan], np.float32))
    with pytest.raises(FormatError, match="finite"):
        load_membership(tmp_path, "vase")
    for text in ("{", "[]", '{"version": 1}', '{"version": 99}'):
        (folder / "object.json").write_text(text)
        with pytest.raises(FormatError, match=r"object\.json"):
            list_objects(tmp_path)


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
