"""A measuring run may end anywhere: the next one measures what is missing, with the frozen method, nothing twice."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from benchmarks.rooms.draws import CHOOSING_ROOMS, Room
from benchmarks.rooms.repository import Repository
from benchmarks.rooms.results import read_result, result_file
from benchmarks.rooms.running import MeasuringRun, is_rendered, run_command
from engine.core.errors import EnvironmentProblem, FormatError, HeritageError, ProjectError, SettingsError
from tests.conftest import ROOT

from .made_up import measured
from .repositories import commit, make_repository

ROOMS = CHOOSING_ROOMS[:2]


@pytest.fixture
def repository(tmp_path: Path) -> Repository:
    return make_repository(tmp_path / "repository")


def render(folder: Path, *, photos: Sequence[str] = ("view_00.jpg", "view_01.jpg")) -> None:
    """Write the files of a rendered room."""
    for file in ("truth/names.json", "truth/absent.json", "cameras/images.txt"):
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text("{}", encoding="utf-8")
    (folder / "truth" / "masks").mkdir()
    (folder / "photos").mkdir()
    for photo in photos:
        (folder / "photos" / photo).write_text(folder.name, encoding="utf-8")
        (folder / "truth" / "masks" / photo).with_suffix(".png").write_text("mask", encoding="utf-8")
    cameras = {"photos": [{"file": photo} for photo in photos]}
    (folder / "truth" / "cameras.json").write_text(json.dumps(cameras), encoding="utf-8")


@dataclass
class FakePrograms:
    """Does what Blender and the engine would do, and notes it; is stopped at the call number `stop_at`."""

    stop_at: int | None = None
    calls: list[str] = field(default_factory=list)
    methods: list[str] = field(default_factory=list)

    def __call__(self, command: Sequence[str], *, folder: Path, log: Path) -> None:
        words = [*command]
        out = Path(words[words.index("--out") + 1])
        if words[0] == "blender":
            what = f"render {words[words.index('--seed') + 1]}"
        else:
            assert words[:3] == ["engine", "-m", "benchmarks.rooms"]
            what = f"{words[3]} {out.parents[1].name if words[3] == 'measure' else Path(words[4]).name}"
            self.methods.append((folder / "engine" / "code.py").read_text(encoding="utf-8"))
        if len(self.calls) == self.stop_at:
            raise KeyboardInterrupt
        self.calls.append(what)
        if words[0] == "blender":
            render(out)
        elif words[3] == "reconstruct":
            out.mkdir(parents=True, exist_ok=True)
        else:
            assert Path(words[4]).is_dir() and Path(words[5], "names.json").is_file()
            out.write_text(json.dumps(measured()), encoding="utf-8")


def run(repository: Repository, programs: FakePrograms, commits: Sequence[str], rooms: Sequence[Room] = ROOMS) -> None:
    said: list[str] = []
    MeasuringRun(repository, "blender", "engine", call=programs, say=said.append).measure(commits, rooms)
    assert all(line.startswith("[") and " min] " in line for line in said)


ALL_CALLS = ["render 1", "reconstruct room_1", "measure room_1", "render 2", "reconstruct room_2", "measure room_2"]


def test_every_room_is_rendered_reconstructed_and_measured_once(repository: Repository) -> None:
    programs = FakePrograms()
    head = repository.head()
    run(repository, programs, [head])
    assert programs.calls == ALL_CALLS
    result = read_result(repository.root, head, "room_2")
    assert result is not None
    assert (result["room"], result["seed"], result["commit"]) == ("room_2", 2, head)
    assert result["rendered"]["whole"] and result["mask"] == measured()["mask"]
    run(repository, programs, [head])
    assert programs.calls == ALL_CALLS


def test_rooms_are_rendered_once_for_other_benchmarks(repository: Repository) -> None:
    programs = FakePrograms()
    for _ in range(2):
        MeasuringRun(repository, "blender", "engine", call=programs, say=lambda text: None).render(ROOMS)
    assert programs.calls == ["render 1", "render 2"]
    assert is_rendered(repository.root / "out" / "rooms" / "room_2")


def test_rooms_with_models_are_rendered_from_the_folder_that_is_named(repository: Repository, tmp_path: Path) -> None:
    room = Room("models_1", 9, of_models=True)
    commands: list[Sequence[str]] = []

    def call(command: Sequence[str], *, folder: Path, log: Path) -> None:
        commands.append(command)
        render(Path(command[command.index("--out") + 1]))

    with pytest.raises(SettingsError, match="models_1 shows 3D models of other people. Name the folder with --models"):
        MeasuringRun(repository, "blender", "engine", call=call, say=lambda text: None).render([room])
    assert commands == []
    run = MeasuringRun(repository, "blender", "engine", call=call, say=lambda text: None, models=tmp_path)
    run.render([room, ROOMS[0]])
    assert [command[-2:] == ["--models", str(tmp_path)] for command in commands] == [True, False]


def test_results_of_another_session_are_not_measured_again(repository: Repository) -> None:
    head = repository.head()
    run(repository, FakePrograms(), [head], ROOMS[:1])
    # Only the committed results are left.
    (repository.root / "out" / "rooms" / "room_1").rename(repository.root / "out" / "elsewhere")
    programs = FakePrograms()
    run(repository, programs, [head])
    assert programs.calls == ALL_CALLS[3:]


@pytest.mark.parametrize("stop_at", range(len(ALL_CALLS)))
def test_a_stopped_run_continues_with_the_call_that_it_did_not_finish(repository: Repository, stop_at: int) -> None:
    head = repository.head()
    stopped = FakePrograms(stop_at)
    with pytest.raises(KeyboardInterrupt):
        run(repository, stopped, [head])
    assert stopped.calls == ALL_CALLS[:stop_at]
    assert result_file(repository.root, head, "room_1").exists() == (stop_at >= 3)
    continued = FakePrograms()
    run(repository, continued, [head])
    # The engine itself continues a reconstruction, so it is asked again before measuring.
    again = [f"reconstruct room_{1 + stop_at // 3}"] if stop_at % 3 == 2 else []
    assert continued.calls == again + ALL_CALLS[stop_at:]


def test_two_methods_get_the_same_photos(repository: Repository) -> None:
    first = repository.head()
    second = commit(repository, "engine/code.py", "METHOD = 2\n")
    programs = FakePrograms()
    run(repository, programs, [first, second], ROOMS[:1])
    assert programs.calls == ["render 1", *["reconstruct room_1", "measure room_1"] * 2]
    assert programs.methods == ["METHOD = 1\n"] * 2 + ["METHOD = 2\n"] * 2
    results = [read_result(repository.root, one, "room_1") for one in (first, second)]
    assert results[0] is not None and results[1] is not None
    assert results[0]["pictures"] == results[1]["pictures"]


def test_edits_during_the_run_do_not_change_the_method(repository: Repository) -> None:
    head = repository.head()
    (repository.root / "engine" / "code.py").write_text("METHOD = 'edited'\n", encoding="utf-8")
    programs = FakePrograms()
    run(repository, programs, [head], ROOMS[:1])
    # Nor do edits of the worktree itself: it is made anew.
    tree = repository.root / "out" / "rooms" / "methods" / head[:12]
    (tree / "engine" / "code.py").write_text("METHOD = 'edited'\n", encoding="utf-8")
    run(repository, programs, [head], ROOMS[1:])
    assert programs.methods == ["METHOD = 1\n"] * 4


def test_an_incomplete_worktree_is_made_anew(repository: Repository) -> None:
    head = repository.head()
    tree = repository.worktree(repository.root / "out" / "tree", head)
    (tree / "engine" / "code.py").unlink()
    assert repository.worktree(tree, head) == tree and (tree / "engine" / "code.py").is_file()


def test_a_folder_in_the_way_of_a_worktree_is_not_deleted(repository: Repository) -> None:
    folder = repository.root / "out" / "tree"
    (folder / "mine").mkdir(parents=True)
    with pytest.raises(ProjectError, match="is in the way of a worktree"):
        repository.worktree(folder, repository.head())
    assert (folder / "mine").is_dir()


@pytest.mark.parametrize("missing", ["photos/view_01.jpg", "truth/masks/view_00.png", "truth/absent.json"])
def test_a_half_rendered_room_is_rendered_to_its_end(tmp_path: Path, missing: str) -> None:
    assert not is_rendered(tmp_path)
    render(tmp_path)
    assert is_rendered(tmp_path)
    (tmp_path / missing).unlink()
    assert not is_rendered(tmp_path)


def test_a_room_that_rendering_leaves_incomplete_is_told(repository: Repository) -> None:
    def forget(command: Sequence[str], *, folder: Path, log: Path) -> None:
        """A program that does nothing and does not fail."""

    with pytest.raises(HeritageError, match="room_1 lacks photos or masks after it was rendered"):
        MeasuringRun(repository, "blender", "engine", call=forget, say=lambda line: None).measure(
            [repository.head()], ROOMS
        )


def test_the_result_of_another_room_is_refused(repository: Repository) -> None:
    head = repository.head()
    run(repository, FakePrograms(), [head], ROOMS[:1])
    file = result_file(repository.root, head, "room_1")
    file.rename(file.with_name("room_2.json"))
    with pytest.raises(FormatError, match="holds the result of room_1"):
        read_result(repository.root, head, "room_2")


def test_a_commit_that_does_not_exist_is_told_in_a_sentence(repository: Repository) -> None:
    with pytest.raises(ProjectError, match="has no commit 'abcdef'. Fetch it, or name another one"):
        repository.full_commit("abcdef")


def test_an_unpacked_archive_is_told_in_a_sentence(tmp_path: Path) -> None:
    assert not Repository(tmp_path).has_history()
    with pytest.raises(ProjectError, match="is not a git repository"):
        Repository(tmp_path).head()


def test_without_git_the_user_is_told_what_to_install(repository: Repository, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(EnvironmentProblem, match="git is not installed"):
        repository.head()


def test_a_failing_command_is_told_by_its_last_line(tmp_path: Path) -> None:
    log = tmp_path / "logs" / "log.txt"
    script = "import sys; print('details'); sys.stderr.write('The disk is full. Free some space.\\n'); sys.exit(1)"
    with pytest.raises(HeritageError, match=r"^The disk is full. Free some space. The whole output is in .*log.txt.$"):
        run_command([sys.executable, "-c", script], folder=tmp_path, log=log)
    assert "details" in log.read_text(encoding="utf-8")


def test_a_program_that_does_not_exist_is_told_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(EnvironmentProblem, match="no-blender does not exist. Run `make setup`"):
        run_command([str(tmp_path / "no-blender")], folder=tmp_path, log=tmp_path / "log.txt")


@pytest.mark.skipif(os.name == "nt", reason="SIGTERM ends a process on Windows without a chance to react")
def test_a_run_that_is_told_to_stop_ends_its_command(tmp_path: Path) -> None:
    log = tmp_path / "log.txt"
    command = [sys.executable, "-c", "import os, time; print(os.getpid(), flush=True); time.sleep(600)"]
    script = (
        "import pathlib, signal\n"
        "from benchmarks.rooms.__main__ import _interrupt\n"
        "from benchmarks.rooms.running import run_command\n"
        "signal.signal(signal.SIGTERM, _interrupt)\n"
        f"run_command({command!r}, folder=pathlib.Path({str(tmp_path)!r}), log=pathlib.Path({str(log)!r}))\n"
    )
    driver = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, stderr=subprocess.DEVNULL)
    while not (log.exists() and log.read_text(encoding="utf-8").endswith("\n")):
        assert driver.poll() is None, "the command was not started"
        time.sleep(0.01)
    driver.terminate()
    assert driver.wait() != 0
    with pytest.raises(ProcessLookupError):
        os.kill(int(log.read_text(encoding="utf-8")), 0)
