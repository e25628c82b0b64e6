"""Pairs are matched by several processes, with the bits of one; what a stopped or killed run has matched stays."""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
import signal
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from engine.cameras import matching, processes
from engine.cameras.features import SfmWorkspace, match_features
from engine.cameras.matching import match_pairs
from engine.cameras.processes import detecting_cores, matching_processes
from engine.cameras.settings import CameraSettings
from engine.core import shares
from engine.core.errors import CameraError, Cancelled
from engine.core.events import never_stop

from .conftest import Scene

QUICK = CameraSettings(max_side=400, max_features=600, first_octave=0, threads=1)


@pytest.fixture(scope="module")
def matched(room: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a database whose 28 pairs one process has matched."""
    workspace = SfmWorkspace(tmp_path_factory.mktemp("matched") / "work", room.photo_set, QUICK)
    match_features(workspace, report=lambda done, message: None, should_stop=never_stop)
    return workspace.database


@pytest.fixture
def features(matched: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy without the matches, whose pairs are matched by as many processes as `threads` says."""
    for module in (processes, matching):
        monkeypatch.setattr(module, "MIN_PAIRS", 4)
    monkeypatch.setattr(matching, "_PAIRS_PER_BATCH", 2)
    database = tmp_path / "database.db"
    shutil.copyfile(matched, database)
    with sqlite3.connect(database) as opened:
        opened.execute("DELETE FROM matches")
        opened.execute("DELETE FROM two_view_geometries")
    opened.close()
    return database


def all_pairs_of(database: Path) -> list[tuple[str, str]]:
    opened = sqlite3.connect(database)
    names = [name for (name,) in opened.execute("SELECT name FROM images ORDER BY name")]
    opened.close()
    return list(itertools.combinations(names, 2))


def content(database: Path) -> list[list[tuple[Any, ...]]]:
    opened = sqlite3.connect(database)
    rows = [list(opened.execute(f"SELECT * FROM {table}")) for table in ("matches", "two_view_geometries")]
    opened.close()
    return rows


def match(database: Path, count: int, *, report: Any = lambda done: None, should_stop: Any = never_stop) -> None:
    settings = CameraSettings(threads=count)
    match_pairs(database, all_pairs_of(database), settings, report=report, should_stop=should_stop)


def test_several_processes_find_what_one_finds_bit_for_bit(features: Path, matched: Path) -> None:
    match(features, 3)
    assert content(features) == content(matched)
    assert not (features.parent / "shares").exists()


@pytest.fixture
def halted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Halt the second process before it matches a pair, and return the list that gets its id."""
    started: list[int] = []
    halted: list[int] = []

    @contextlib.contextmanager
    def child_beside(*arguments: Any, **others: Any) -> Iterator[Any]:
        with real(*arguments, **others) as child:
            started.append(child._process.pid)
            if len(started) == 2:
                os.kill(started[-1], signal.SIGSTOP)
                halted.append(started[-1])
            yield child

    real = shares.child_beside
    monkeypatch.setattr(shares, "child_beside", child_beside)
    return halted


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system cannot halt a process")
def test_what_a_stopped_run_has_matched_is_kept(features: Path, matched: Path, halted: list[int]) -> None:
    seen = [0.0]
    with pytest.raises(Cancelled):
        # The other process has taken all pairs, and ends when they are matched.
        match(features, 2, report=seen.append, should_stop=lambda: seen[-3:] == [1.0] * 3)
    with pytest.raises(ProcessLookupError):
        os.kill(halted[0], 0)
    assert not (features.parent / "shares").exists()
    kept = len(content(features)[1])
    assert kept >= 28 - 2  # one batch may be unfinished
    match(features, 1, report=seen.append)
    assert seen[seen.index(1.0) :][3] == pytest.approx(kept / 28)
    assert content(features) == content(matched)


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system cannot halt a process")
def test_killed_process_is_an_error_and_what_the_others_matched_is_kept(
    features: Path, matched: Path, halted: list[int]
) -> None:
    def kill(done: float) -> None:
        if done == 1.0:
            os.kill(halted[0], signal.SIGKILL)

    with pytest.raises(CameraError, match="is kept"):
        match(features, 2, report=kill)
    assert len(content(features)[1]) >= 28 - 2
    match(features, 1)
    assert content(features) == content(matched)


def test_pairs_that_a_lost_process_had_taken_are_matched_at_the_end(
    features: Path, matched: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run_shares(*arguments: Any, folder: Path, **others: Any) -> None:
        (folder / "taken-3").mkdir()
        real(*arguments, folder=folder, **others)

    real = matching.run_shares
    monkeypatch.setattr(matching, "run_shares", run_shares)
    match(features, 2)
    assert content(features) == content(matched)


def test_shares_of_a_killed_run_are_merged_by_the_next_one(features: Path, matched: Path) -> None:
    # As a run leaves them that was killed: with all features, and a part of the matches.
    share = features.parent / "shares" / "000" / "database.db"
    share.parent.mkdir(parents=True)
    shutil.copyfile(matched, share)
    damaged = features.parent / "shares" / "001" / "database.db"
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(matched.read_bytes()[:5000])
    strange = features.parent / "shares" / "002" / "database.db"
    strange.parent.mkdir(parents=True)
    opened = sqlite3.connect(strange)
    opened.execute("CREATE TABLE matches (pair_id INTEGER)")
    opened.close()
    opened = sqlite3.connect(share)
    opened.execute("DELETE FROM two_view_geometries WHERE pair_id IN (SELECT max(pair_id) FROM matches)")
    opened.commit()
    opened.close()
    seen: list[float] = []
    match(features, 1, report=seen.append)
    assert seen[0] == pytest.approx(27 / 28)
    assert content(features) == content(matched)


def test_processes_and_cores_follow_the_pairs_and_the_free_memory() -> None:
    assert matching_processes(8, 10_000, free=None) == 8
    assert matching_processes(8, 90, free=None) == 2
    assert matching_processes(8, 10, free=None) == 1
    assert matching_processes(8, 10_000, free=1_400_000_000) == 3
    assert matching_processes(8, 10_000, free=0) == 1
    # 195 MB a core for copies of 1000 x 750 pixels.
    assert detecting_cores(16, 750_000, free=None) == 16
    assert detecting_cores(16, 750_000, free=2_000_000_000) == 5
    assert detecting_cores(16, 750_000, free=0) == 1
