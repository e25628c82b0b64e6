"""kill -9 in the middle of what replaces a user's work loses nothing: the quick part of `make kills`."""

from __future__ import annotations

import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from benchmarks.security.kills_checks import damaged_files, files_of, leftovers, objects_of, opened_copy
from benchmarks.security.kills_fixture import require_objects
from benchmarks.security.kills_process import wait_for_write
from tests.conftest import PATIENCE
from tests.engine.command_line import call, start
from tests.engine.finished_project import write_finished_project

pytestmark = pytest.mark.skipif(os.name == "nt", reason="kill -9 is POSIX")

KILL_AT_RENAME = """
import os, signal
rename, number = os.replace, 0
def replace(*paths, **options):
    global number
    number += 1
    if number == {number}:
        os.kill(os.getpid(), signal.SIGKILL)
    rename(*paths, **options)
os.replace = replace
"""
"""A file is written under another name and renamed: a kill there finds the new file whole, and the old one in place."""


@pytest.fixture
def project(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """A finished project with two objects and their background."""
    made = write_finished_project(tmp_path)
    assert call(capsys, "segment", made, "--complement").code == 0
    return made


def test_kills_are_not_made_in_a_project_without_the_objects_that_a_kill_could_lose(tmp_path: Path) -> None:
    made = write_finished_project(tmp_path)
    require_objects(made, ("teapot", "box"))
    with pytest.raises(RuntimeError, match="no bell"):
        require_objects(made, ("teapot", "bell"))


@pytest.mark.parametrize("number", [1, 2, 4])
def test_background_that_is_replaced_is_the_old_or_the_new_one_after_a_kill(
    number: int, project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(project / "objects" / "box")
    before = objects_of(project)
    whole = tmp_path / "whole" / "project"
    shutil.copytree(project, whole)
    assert call(capsys, "segment", whole, "--complement").code == 0
    expected = objects_of(whole)
    assert expected["background"] != before["background"]

    killed = start("segment", project, "--complement", before=KILL_AT_RENAME.format(number=number))
    killed.communicate(timeout=PATIENCE)
    assert killed.returncode == -signal.SIGKILL
    assert damaged_files(project) == []
    with opened_copy(project) as copy:
        assert copy is not None
        now = objects_of(copy)
    assert now["teapot"] == before["teapot"]
    in_trash = sorted(project.glob("trash/*/object/membership.npy"))
    assert now.get("background") in (before["background"], expected["background"]) or in_trash

    assert call(capsys, "segment", project, "--complement").code == 0
    assert objects_of(project) == expected
    assert leftovers(project) == []


@pytest.mark.parametrize("suffix", ["ply", "glb"])
def test_file_that_an_export_replaces_is_the_old_one_until_the_new_one_is_whole(
    suffix: str, project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"out.{suffix}"
    # The record says when it was exported.
    command = ["export", project, "--format", suffix, "--record", "none", "--out", out, "--overwrite"]
    assert call(capsys, *command).code == 0
    new = out.read_bytes()
    out.write_bytes(b"old")
    killed = start(*command, before=KILL_AT_RENAME.format(number=1))
    killed.communicate(timeout=PATIENCE)
    assert killed.returncode == -signal.SIGKILL
    assert out.read_bytes() == b"old"
    assert call(capsys, *command).code == 0
    assert out.read_bytes() == new


def test_checks_of_kills_find_what_a_kill_must_not_leave(project: Path) -> None:
    assert damaged_files(project) == leftovers(project) == []
    for name in ("gaussians/scene.ply", "objects/teapot/membership.npy", "cameras/points.npz", "photos/photos.json"):
        file = project / name
        whole = file.read_bytes()
        file.write_bytes(whole[: len(whole) // 2])
        assert any(problem.startswith(f"{name}: ") for problem in damaged_files(project)), name
        file.write_bytes(whole)
    (project / "masks" / ".writing-x.npz").write_bytes(b"half")
    assert damaged_files(project) == []
    assert leftovers(project) == ["masks/.writing-x.npz"]
    assert "masks/.writing-x.npz" in files_of(project)


def test_wait_for_write_ends_at_a_temporary_file_or_with_its_time(tmp_path: Path) -> None:
    begin = time.monotonic()
    wait_for_write(tmp_path, 0.05, gone=lambda: False)
    assert time.monotonic() - begin >= 0.05
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / ".writing-x").touch()
    wait_for_write(tmp_path, 3600.0, gone=lambda: False)
