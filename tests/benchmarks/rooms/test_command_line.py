"""What is wrong is said in one sentence with exit code 1, and a stopped run says how to continue."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from benchmarks.rooms import __main__ as command_line
from benchmarks.rooms.draws import DRAWS_FILE, read_draws
from benchmarks.rooms.repository import Repository
from benchmarks.rooms.results import result_file

from .made_up import measured
from .repositories import commit, make_repository


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Repository:
    repository = make_repository(tmp_path / "repository")
    monkeypatch.setattr(command_line, "ROOT", repository.root)
    return repository


@pytest.fixture
def measured_rooms(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """The (commit, room) pairs that the run measured, in place of rendering and training."""
    found: list[tuple[str, str]] = []

    class Run(command_line.MeasuringRun):
        def _measure_room(self, room, commit, what):  # type: ignore[no-untyped-def]
            found.append((commit, room.name))
            result = {"room": room.name, "seed": room.seed, "commit": commit, "pictures": "", **measured()}
            file = result_file(self.repository.root, commit, room.name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(result), encoding="utf-8")
            return result

    monkeypatch.setattr(command_line, "MeasuringRun", Run)
    return found


def run(arguments: Sequence[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = command_line.main(arguments)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_a_method_is_drawn_measured_and_shown(
    repository: Repository, measured_rooms: list[tuple[str, str]], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    document = tmp_path / "segmentation.md"
    code, shown, _ = run(["run", "--draw", "better votes", "--doc", str(document)], capsys)
    assert code == 0 and len(measured_rooms) == 8 + 5
    row = f"| {repository.head()[:8]} | better votes |"
    assert "5 test (*test*)" in shown and row in shown and row in document.read_text(encoding="utf-8")
    assert read_draws(repository.root)[0].reason == "better votes"
    assert run(["run"], capsys)[0] == 0 and len(measured_rooms) == 13, "nothing is measured twice"


def test_an_earlier_method_is_measured_on_its_own_test_rooms(
    repository: Repository, measured_rooms: list[tuple[str, str]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["run", "--draw", "first", "--rooms", "choosing"], capsys)[0] == 0
    first = repository.head()
    measured_rooms.clear()
    method = commit(repository, "engine/code.py", "METHOD = 2\n")
    assert run(["run", "--draw", "better votes", "--rooms", "test"], capsys)[0] == 0
    assert measured_rooms == [(method, f"test_{method[:8]}_{number}") for number in range(1, 6)]
    measured_rooms.clear()
    assert run(["run", "--commit", first[:10], "--only", f"test_{first[:8]}_2"], capsys)[0] == 0
    assert measured_rooms == [(first, f"test_{first[:8]}_2")]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["run"], "No method is frozen yet. Commit it, then run `make test-rooms DRAW=REASON`."),
        (["table"], "No method is frozen yet."),
        (["keep"], "No method is frozen yet."),
        (["run", "--draw", "a", "--commit", "b"], "Give only one."),
        (["run", "--draw", " "], "A draw needs a reason."),
        (["run", "--draw", "a", "--only", "room_9"], "There is no room 'room_9' here, only room_1, room_2"),
        (["unpack", "room_1", "--out", "new"], "room_1.tar.xz cannot be read: No such file"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(
    repository: Repository, capsys: pytest.CaptureFixture[str], arguments: list[str], problem: str
) -> None:
    code, _, said = run(arguments, capsys)
    assert code == 1 and problem in said and "Traceback" not in said and said.count("\n") == 1


def test_a_damaged_list_of_draws_is_said_in_a_sentence(
    repository: Repository, capsys: pytest.CaptureFixture[str]
) -> None:
    (repository.root / DRAWS_FILE).write_text("[{]", encoding="utf-8")
    code, _, said = run(["table"], capsys)
    assert code == 1 and "draws.json cannot be read" in said


def raising(error: BaseException) -> Callable[..., None]:
    def measure(*arguments: object) -> None:
        raise error

    return measure


def test_ctrl_c_ends_the_run_with_a_sentence(
    repository: Repository, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command_line.MeasuringRun, "measure", raising(KeyboardInterrupt()))
    code, _, said = run(["run", "--draw", "better votes"], capsys)
    assert (code, said) == (130, "Stopped. Run the same command again to continue.\n")


def test_a_full_disk_is_said_in_a_sentence(
    repository: Repository, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    error = OSError(28, "No space left on device", "out/rooms/room_1")
    monkeypatch.setattr(command_line.MeasuringRun, "measure", raising(error))
    code, _, said = run(["run", "--draw", "better votes"], capsys)
    assert code == 1 and "out/rooms/room_1 cannot be used: No space left on device. Check the disk." in said
