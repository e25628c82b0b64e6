"""A hostile project changes nothing outside of its folder: the quick part of `make hostile`."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.security.hostile_audit import watch
from benchmarks.security.hostile_cases import CASES, HONEST, Case, Sandbox
from benchmarks.security.hostile_engine import COMMANDS as ALL_COMMANDS
from benchmarks.security.hostile_engine import run_case
from benchmarks.security.hostile_packages import PACKAGES
from benchmarks.security.tree import changed_bytes, differences, snapshot
from engine.cli.commands import COMMANDS as ENGINE_COMMANDS
from engine.install.models import models_folder

QUICK = (
    "id in object.json: '../../../precious/objects/vase'",
    "folder of an object: '..\\\\..\\\\precious'",
    "name of an object: '../../precious/notes'",
    "photo in cameras.json and photos.json: '../../precious/x.jpg'",
    "link: objects -> precious/target",
    "link: log.jsonl -> precious/dangling.txt",
    "link: trash -> precious/objects",
    "temporary files that are links and folders",
    "links in the trash",
    "complete sets of files that replace others",
    "recorded files of an object that lead out",
    "numbers out of all bounds",
    "scene without Gaussians",
    "truncated scene",
    "object without Gaussians",
)
COMMANDS = (
    "segment --complement", "edit --merge --rename", "edit --level", "edit --delete", "measure", "vocabulary learn",
    "export, PLY", "trash list", "trash restore", "trash empty",
)  # fmt: skip
"""Those that load no model and train nothing."""
LEFT_OUT = {
    "show-clicks": "it reads what `segment --click` reads, and writes nothing",
    "turntable": "`package` makes the same pictures",
    "plan": "it reads the photos as `reconstruct` does, and no project",
    "batch": "it starts `reconstruct` for each folder",
    "frames": "a video, no project",
    "models": "no project",
    "doctor": "no project",
    "serve": "its own tests try hostile requests",
    "remote": "it starts other commands on a worker",
    "evaluate": "for developers, with their own projects",
    "bench": "for developers, with their own projects",
    "stability": "no project",
}
"""Commands that no hostile project is put through, and why."""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="links and file names of POSIX")


class Watched:
    """What an audit hook sees outside of the sandbox. A hook cannot be removed, so there is one for all tests."""

    def __init__(self) -> None:
        self.sandbox: Sandbox | None = None
        self.found: list[str] = []
        watch(self._allowed, self.found.append)

    def _allowed(self) -> list[Path]:
        if self.sandbox is None:
            return [Path("/")]
        # Kernels are compiled for the user once.
        return [*self.sandbox.writable, models_folder().parent.resolve()]


@pytest.fixture(scope="module")
def watched() -> Watched:
    return Watched()


@pytest.fixture
def audited(watched: Watched, tmp_path: Path) -> Iterator[tuple[Sandbox, list[str]]]:
    watched.sandbox = Sandbox(tmp_path / "curator")
    watched.found.clear()
    yield watched.sandbox, watched.found
    watched.sandbox = None


@pytest.mark.parametrize("case", [case for case in CASES if case.name in QUICK], ids=lambda case: case.name)
def test_hostile_project_changes_nothing_outside_of_itself(case: Case, audited: tuple[Sandbox, list[str]]) -> None:
    sandbox, found = audited
    for outcome in run_case(case, COMMANDS, sandbox, found):
        assert outcome.changed == [], outcome.command
        assert outcome.audited == [], outcome.command
        assert not outcome.is_traceback, outcome.sentence


@pytest.mark.parametrize("case", PACKAGES, ids=lambda case: case.name)
def test_hostile_package_is_refused_and_touches_nothing(case: Case, audited: tuple[Sandbox, list[str]]) -> None:
    sandbox, found = audited
    (outcome,) = run_case(case, ("verify",), sandbox, found)
    assert outcome.code != 0
    assert outcome.changed == []
    assert outcome.audited == []
    assert not outcome.is_traceback, outcome.sentence


def test_every_quick_case_exists() -> None:
    assert set(QUICK) <= {case.name for case in CASES}


def test_every_command_is_put_through_or_left_out_with_a_reason() -> None:
    named = (*ALL_COMMANDS, "verify", *(command for case in CASES for command in case.commands))
    assert {name.partition(",")[0].partition(" ")[0] for name in named} >= set(ENGINE_COMMANDS) - set(LEFT_OUT)


def test_honest_project_is_changed_by_the_same_commands(audited: tuple[Sandbox, list[str]]) -> None:
    """Otherwise the cases above would be refused for another reason than the hostile one."""
    sandbox, found = audited
    for outcome in run_case(HONEST, COMMANDS, sandbox, found):
        assert outcome.sentence == "", outcome.command


def test_tree_shows_every_kind_of_change(tmp_path: Path) -> None:
    for name in ("gone", "longer", "same size", "mode", "touched", "folder/inside"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1234", encoding="utf-8")
    (tmp_path / "link").symlink_to("gone")
    before = snapshot(tmp_path)
    (tmp_path / "gone").unlink()
    (tmp_path / "longer").write_text("123456", encoding="utf-8")
    (tmp_path / "same size").write_text("4321", encoding="utf-8")
    (tmp_path / "mode").chmod(0o600)
    os.utime(tmp_path / "touched", (1, 1))
    (tmp_path / "folder" / "new").write_text("12", encoding="utf-8")
    (tmp_path / "link").unlink()
    (tmp_path / "link").symlink_to("longer")
    after = snapshot(tmp_path)
    assert [line.rpartition(" was ")[0] for line in differences(before, after)] == [
        "folder", "folder/new", "gone", "link", "longer", "mode", "same size", "touched",
    ]  # fmt: skip
    assert changed_bytes(before, after) == 2 + 4 + 6 + 4 + 4 + 4
    assert snapshot(tmp_path, without=[tmp_path / "folder"])["folder"] == ("left out",)


def test_audit_hook_sees_every_kind_of_change(audited: tuple[Sandbox, list[str]]) -> None:
    sandbox, found = audited
    sandbox.make(HONEST)
    found.clear()
    outside = sandbox.precious
    (sandbox.project / "inside").write_text("", encoding="utf-8")
    assert found == []
    (sandbox.project / "way").symlink_to(outside)
    (sandbox.project / "way" / "through a link").write_text("", encoding="utf-8")
    (outside / "notes.txt").chmod(0o600)
    os.rename(sandbox.project / "inside", outside / "moved")
    (outside / "moved").unlink()
    (outside / "folder").mkdir()
    os.symlink("x", outside / "link")
    os.truncate(outside / "notes.txt", 0)
    shutil.rmtree(outside / "objects")
    events = [line.partition(" ")[0] for line in found]
    for event in ("open", "os.chmod", "os.rename", "os.remove", "os.mkdir", "os.symlink", "os.truncate", "os.rmdir"):
        assert event in events
    assert f"open {outside.resolve() / 'through a link'}" in found
    assert any(line == f"os.remove {outside.resolve() / 'objects' / 'vase' / 'object.json'}" for line in found)
