"""What is sent arrives whole, stays inside of its folder, and nothing is lost on the way."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.core.errors import FormatError, ProjectError
from engine.workers.batch.shipping import mirror, pack, pack_photos, unpack


def write(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        path = folder / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def test_photos_keep_their_times_of_change(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    (photos / "a.jpg").write_text("a")
    unpack(pack_photos(photos, None), tmp_path / "there")
    assert (tmp_path / "there" / "a.jpg").stat().st_mtime_ns == (photos / "a.jpg").stat().st_mtime_ns


def test_checkpoints_and_working_copies_stay_and_the_trash_travels(tmp_path: Path) -> None:
    project = write(
        tmp_path / "p", lock="", checkpoints__a="x", cameras__sfm_1="", trash__vase="t", objects__o__record="r"
    )
    (project / "cameras" / "sfm-1").mkdir()
    (project / "cameras" / "sfm-1" / "copy").write_text("x")
    assert sorted(pack(project, None)) == ["cameras/sfm_1", "objects/o/record", "trash/vase"]


def test_project_becomes_what_the_worker_made_of_it(tmp_path: Path) -> None:
    here = write(tmp_path / "here", lock="", checkpoints__a="kept", objects__old="vase", report__page="1")
    there = write(tmp_path / "there", trash__old="vase", report__page="2")
    mirror(pack(there, None), here)
    assert not (here / "objects" / "old").exists()
    assert (here / "trash" / "old").read_text() == "vase"
    assert (here / "report" / "page").read_text() == "2"
    assert (here / "checkpoints" / "a").read_text() == "kept"


@pytest.mark.parametrize("name", ["../outside", "/outside", "a/../../outside"])
def test_name_that_leads_out_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(FormatError):
        unpack({name: (0, b"")}, tmp_path / "in")
    assert not (tmp_path / "outside").exists()


def test_too_much_to_send_is_said(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match="Use workers that share the folders"):
        pack(write(tmp_path / "p", a="12345"), 4)
