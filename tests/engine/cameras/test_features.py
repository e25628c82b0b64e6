"""The work folder of structure from motion: what is damaged in it is computed again, and a full disk is said."""

from __future__ import annotations

import shutil
from collections import namedtuple
from pathlib import Path

import pytest

from engine.cameras.colmap_calls import opened_database, translated
from engine.cameras.features import SfmWorkspace
from engine.cameras.settings import CameraSettings
from engine.cameras.sfm import estimate_cameras
from engine.core.errors import CameraError, DiskError, HeritageError
from engine.scene.photo import PhotoSet

from .conftest import Scene

QUICK = CameraSettings(max_side=400, max_features=1000, first_octave=0)


@pytest.fixture(scope="module")
def used(room: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a work folder in which four photos were placed."""
    folder = tmp_path_factory.mktemp("used") / "work"
    estimate_cameras(four_photos(room), folder, QUICK)
    return folder


def four_photos(room: Scene) -> PhotoSet:
    return PhotoSet(room.photo_set.folder, room.photo_set.photos[:4], ())


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


@pytest.mark.parametrize(
    "content", [b"", b'"another"', b"[1]", b"NaN", b"\xff\xfe", b"[" * 100_000], ids=["empty", "other", *"lnub"]
)
def test_key_of_other_photos_or_a_damaged_one_starts_again(
    room: Scene, used: Path, tmp_path: Path, content: bytes
) -> None:
    folder = shutil.copytree(used, tmp_path / "work")
    (folder / "made_from.json").write_bytes(content)
    SfmWorkspace(folder, four_photos(room), QUICK)
    assert [path.name for path in folder.iterdir()] == ["made_from.json"]


def test_key_of_the_same_photos_keeps_what_was_done(room: Scene, used: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(used, tmp_path / "work")
    SfmWorkspace(folder, four_photos(room), QUICK)
    assert (folder / "database.db").read_bytes() == (used / "database.db").read_bytes()


def test_files_of_a_killed_run_are_deleted_though_the_photos_are_the_same(
    room: Scene, used: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(used, tmp_path / "work")
    kept = {path.name for path in folder.iterdir()}
    for name in ("trial-abc", "sparse_beside"):
        (folder / name).mkdir()
        (folder / name / "images.bin").touch()
    for name in ("database.db.beside", "database.db.beside-journal"):
        (folder / name).touch()
    SfmWorkspace(folder, four_photos(room), QUICK)
    assert {path.name for path in folder.iterdir()} == kept


@pytest.mark.parametrize("damage", [cut, lambda file: file.write_bytes(b"nonsense" * 1000)], ids=["cut", "overwritten"])
def test_damaged_database_is_made_again(room: Scene, used: Path, tmp_path: Path, damage: object) -> None:
    folder = shutil.copytree(used, tmp_path / "work")
    damage(folder / "database.db")  # type: ignore[operator]
    assert len(estimate_cameras(four_photos(room), folder, QUICK).cameras) == 4


def test_copy_of_a_photo_that_is_cut_is_made_again(room: Scene, used: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(used, tmp_path / "work")
    copy = next((folder / "images").rglob("*.jpg"))
    whole = copy.read_bytes()
    cut(copy)
    estimate_cameras(four_photos(room), folder, QUICK)
    assert copy.read_bytes() == whole


def test_link_in_the_work_folder_is_deleted_and_not_what_it_leads_to(room: Scene, used: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(used, tmp_path / "work")
    other = shutil.copytree(used / "images", tmp_path / "work" / "other")
    shutil.rmtree(folder / "images")
    (folder / "images").symlink_to(other)
    (folder / "made_from.json").unlink()
    SfmWorkspace(folder, four_photos(room), QUICK)
    assert list(other.rglob("*.jpg")) and not (folder / "images").exists()


def test_disk_that_is_nearly_full_stops_before_colmap_ends_the_process(
    room: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**9, 99 * 10**7, 10**7))
    with pytest.raises(DiskError, match="is nearly full: 10 MB are free"):
        estimate_cameras(four_photos(room), tmp_path / "work", QUICK)


def test_database_that_cannot_be_created_is_an_error_of_the_disk(tmp_path: Path) -> None:
    with (
        pytest.raises(DiskError, match=r"database\.db\. Free some space and run again"),
        opened_database(tmp_path / "missing" / "database.db"),
    ):
        pass


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        ("[database_sqlite.cc:1296] SQLite error: database or disk is full", DiskError),
        ("SQLite error: disk I/O error", DiskError),
        ("SQLite error: attempt to write a readonly database", DiskError),
        ("No registered database factory succeeded.", DiskError),
        ("Check failed: images.size() > 0", CameraError),
    ],
)
def test_error_of_colmap_becomes_one_of_ours(message: str, kind: type[HeritageError]) -> None:
    with pytest.raises(kind), translated("matching the photos"):
        raise RuntimeError(message)
