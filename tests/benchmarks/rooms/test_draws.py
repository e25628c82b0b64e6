"""Test rooms follow from the commit that freezes a method, and a draw that was made once stays."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from benchmarks.rooms.draws import (
    CHOOSING_ROOMS,
    DRAWS_FILE,
    Draw,
    append_draw,
    draw_now,
    read_draws,
    rewritten_draw,
    rooms_of,
    test_seeds,
)
from benchmarks.rooms.repository import Repository
from engine.core.errors import FormatError, ProjectError
from tests.conftest import ROOT

from .repositories import commit, git, make_repository

HASHES = [hashlib.sha1(bytes([number])).hexdigest() for number in range(3)]


@pytest.fixture
def repository(tmp_path: Path) -> Repository:
    return make_repository(tmp_path / "repository")


def entry(commit_hash: str, **changed: object) -> dict[str, object]:
    seeds = list(test_seeds(commit_hash))
    return {"commit": commit_hash, "reason": "a reason", "date": "2026-01-02", "seeds": seeds, **changed}


def write_draws(root: Path, entries: list[dict[str, object]]) -> str:
    text = json.dumps(entries)
    (root / DRAWS_FILE).parent.mkdir(parents=True, exist_ok=True)
    (root / DRAWS_FILE).write_text(text, encoding="utf-8")
    return text


def test_choosing_rooms_have_the_seeds_1_to_8() -> None:
    assert [(room.name, room.seed) for room in CHOOSING_ROOMS] == [(f"room_{n}", n) for n in range(1, 9)]


def test_seeds_of_test_rooms_follow_from_the_commit() -> None:
    digest = hashlib.sha256(f"{HASHES[0]} test room 1".encode()).hexdigest()
    assert test_seeds(HASHES[0])[0] == int(digest[:8], 16)
    assert len(set(test_seeds(HASHES[0]))) == 5
    assert not set(test_seeds(HASHES[0])) & set(test_seeds(HASHES[1]))


def test_seeds_of_test_rooms_are_never_those_of_choosing_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    # The second number would be the seed of room_7, the fourth that of a choosing room of models.
    digests = iter(f"{number:08x}" for number in (100, 7, 200, 12343, 300, 400, 500))

    class Digest:
        def hexdigest(self) -> str:
            return next(digests)

    monkeypatch.setattr("benchmarks.rooms.draws.hashlib.sha256", lambda data: Digest())
    assert test_seeds(HASHES[0]) == (100, 200, 300, 400, 500)


def test_a_draw_names_its_rooms_after_its_commit() -> None:
    draw = Draw(HASHES[0], "", "", test_seeds(HASHES[0]))
    assert [room.name for room in rooms_of(draw, "test")] == [f"test_{HASHES[0][:8]}_{n}" for n in range(1, 6)]
    assert rooms_of(draw, "all") == (*CHOOSING_ROOMS, *draw.test_rooms)
    assert rooms_of(draw, "choosing") == CHOOSING_ROOMS


def test_a_draw_has_further_rooms_with_models_of_other_people() -> None:
    draw = Draw(HASHES[0], "", "", test_seeds(HASHES[0]))
    rooms = rooms_of(draw, "models")
    assert [room.name for room in rooms] == [f"models_{HASHES[0][:8]}_{n}" for n in range(1, 6)]
    assert all(room.of_models for room in rooms) and not any(room.of_models for room in rooms_of(draw, "all"))
    assert not {room.seed for room in rooms} & {room.seed for room in draw.test_rooms}


def test_freezing_a_commit_draws_once(repository: Repository) -> None:
    first = draw_now(repository, "baseline")
    assert first == Draw(repository.head(), "baseline", first.date, test_seeds(repository.head()))
    assert draw_now(repository, "another reason") == first
    assert read_draws(repository.root) == (first,)
    commit(repository, "engine/code.py", "METHOD = 2\n")
    second = draw_now(repository, "a better method")
    assert read_draws(repository.root) == (first, second)
    assert rewritten_draw(repository) is None


@pytest.mark.parametrize("file", ["engine/code.py", "engine/new.py", "demo/code.py", "benchmarks/rooms/running.py"])
def test_a_method_with_uncommitted_changes_cannot_be_frozen(repository: Repository, file: str) -> None:
    (repository.root / file).write_text("METHOD = 3\n", encoding="utf-8")
    with pytest.raises(ProjectError, match=f"{file} has changes that are not committed. Commit them first"):
        draw_now(repository, "baseline")
    assert read_draws(repository.root) == ()


def test_changes_elsewhere_and_new_results_do_not_hinder_a_draw(repository: Repository) -> None:
    new = ("docs/segmentation.md", "benchmarks/rooms/results/0/room_1.json", "demo/random_rooms/choosing/room_1.tar.xz")
    for file in new:
        (repository.root / file).parent.mkdir(parents=True, exist_ok=True)
        (repository.root / file).write_text("new", encoding="utf-8")
    assert draw_now(repository, "baseline").reason == "baseline"


def test_an_earlier_draw_is_committed_before_the_next(repository: Repository) -> None:
    draw_now(repository, "baseline")
    git(repository.root, "commit", "--quiet", "--allow-empty", "--message", "Next")
    with pytest.raises(ProjectError, match="draws.json has changes that are not committed"):
        draw_now(repository, "next")


@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        (lambda entries: entries[1:], "changed or left out a draw"),
        (lambda entries: [{**entries[0], "reason": "another"}, *entries[1:]], "changed or left out a draw"),
        (lambda entries: entries[::-1], "changed or left out a draw"),
        (lambda entries: [*entries, entry(HASHES[2])], None),
    ],
)
def test_a_rewritten_list_of_draws_is_detected(repository: Repository, changed, problem: str | None) -> None:  # type: ignore[no-untyped-def]
    entries = [entry(HASHES[0]), entry(HASHES[1])]
    commit(repository, DRAWS_FILE.as_posix(), json.dumps(entries))
    assert rewritten_draw(repository) is None
    write_draws(repository.root, changed(entries))
    found = rewritten_draw(repository)
    assert found is None if problem is None else problem in str(found)
    # A commit does not hide it.
    git(repository.root, "commit", "--quiet", "--all", "--message", "Rewrite")
    found = rewritten_draw(repository)
    assert found is None if problem is None else problem in str(found)


def test_a_list_that_was_deleted_once_is_detected(repository: Repository) -> None:
    git(repository.root, "rm", "--quiet", DRAWS_FILE.as_posix())
    git(repository.root, "commit", "--quiet", "--message", "Delete")
    commit(repository, DRAWS_FILE.as_posix(), "[]\n")
    assert "deleted" in str(rewritten_draw(repository))


def test_a_rewritten_list_takes_no_more_draws(repository: Repository) -> None:
    commit(repository, DRAWS_FILE.as_posix(), json.dumps([entry(HASHES[0])]))
    commit(repository, DRAWS_FILE.as_posix(), "[]")
    with pytest.raises(ProjectError, match="left out a draw"):
        draw_now(repository, "baseline")


@pytest.mark.parametrize(
    ("entries", "problem"),
    [
        ([entry(HASHES[0], seeds=[9, 10, 11, 12, 13])], "seeds that do not follow from its commit"),
        ([entry("HEAD")], "'HEAD', which is not the full hash"),
        ([entry(HASHES[0]), entry(HASHES[0])], "a second time"),
        ([{"commit": HASHES[0]}], "`.0..reason` is missing"),
        ({"commit": HASHES[0]}, "must be a list"),
    ],
)
def test_a_list_that_cannot_be_is_refused_in_a_sentence(tmp_path: Path, entries: object, problem: str) -> None:
    write_draws(tmp_path, entries)  # type: ignore[arg-type]
    with pytest.raises(FormatError, match=problem) as caught:
        read_draws(tmp_path)
    assert "draws.json" in str(caught.value) and "Restore it with git" in str(caught.value)


def test_appending_keeps_the_earlier_lines(tmp_path: Path) -> None:
    write_draws(tmp_path, [])
    draws = [Draw(one, "wörds", "2026-01-02", test_seeds(one)) for one in HASHES]
    texts = []
    for draw in draws:
        append_draw(tmp_path, draw)
        texts.append((tmp_path / DRAWS_FILE).read_text(encoding="utf-8").removesuffix("\n]\n"))
    assert texts[1].startswith(texts[0]) and texts[2].startswith(texts[1])
    assert read_draws(tmp_path) == tuple(draws)


def test_draws_of_this_repository_were_only_ever_appended() -> None:
    """Without a history, as in an unpacked archive, only the seeds are checked against the commits."""
    draws = read_draws(ROOT)
    repository = Repository(ROOT)
    if repository.has_history():
        assert rewritten_draw(repository) is None
    assert all(draw.seeds == test_seeds(draw.commit) for draw in draws)
