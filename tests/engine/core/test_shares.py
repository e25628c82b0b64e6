"""Processes here and on helpers take the items of a work, each item once."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from engine.core import shares
from engine.core.errors import CameraError, Cancelled
from engine.core.events import never_stop
from engine.core.shares import Need, count_taken, helped_by, helper_places, run_shares, taken_items

ONE_CORE = Need(cores=1, memory=100)


class Call:
    """Processes of a helper, which work as often as they are asked."""

    def __init__(self, times: int) -> None:
        self.left, self.was_ended = times, False

    @property
    def works(self) -> bool:
        self.left -= 1
        return self.left >= 0

    def end(self) -> None:
        self.was_ended = True


class Computer:
    """A helper with some cores, which is free until it is called."""

    def __init__(self, cores: int, works: int = 0) -> None:
        self._cores, self._works = cores, works
        self.calls: list[Call] = []
        self.counts: list[int] = []

    def free(self) -> Sequence[Computer]:
        return [] if self.calls else [self]

    def places(self, need: Need) -> int:
        return self._cores // need.cores

    def begin(self, function: str, arguments: dict[str, Any], count: int, need: Need, *, what: str) -> Call:
        self.counts.append(count)
        self.calls.append(Call(self._works))
        return self.calls[-1]


class Child:
    finished = True

    def end(self) -> None:
        """It has ended."""


@pytest.fixture
def takes(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Let a process of this computer take so many items and end."""

    def set_up(count: int) -> None:
        @contextlib.contextmanager
        def child_beside(function: str, arguments: dict[str, Any], *, what: str) -> Iterator[Child]:
            for _ in zip(range(count), taken_items(Path(arguments["folder"]), 6), strict=False):
                pass
            yield Child()

        monkeypatch.setattr(shares, "child_beside", child_beside)

    return set_up


def run(
    folder: Path, *, processes: int = 1, watch: Callable[[], None] = lambda: None,
    should_stop: Callable[[], bool] = never_stop,
) -> None:  # fmt: skip
    run_shares(
        "work:take", {"folder": str(folder)}, 6, ONE_CORE, folder=folder, what="counting", processes=processes,
        watch=watch, should_stop=should_stop,
    )  # fmt: skip


def test_no_item_is_taken_twice(tmp_path: Path) -> None:
    first, second = taken_items(tmp_path, 5), taken_items(tmp_path, 5)
    assert [next(first), next(second), next(first), *second, *first] == [0, 1, 2, 3, 4]
    assert count_taken(tmp_path) == 5


def test_helpers_count_where_the_engine_may_use_them() -> None:
    assert helper_places(ONE_CORE) == 0
    with helped_by(lambda: Computer(4)):
        assert helper_places(ONE_CORE) == 4 and helper_places(Need(cores=2, memory=100)) == 2


def test_helper_gets_processes_while_items_are_left(tmp_path: Path, takes: Callable[[int], None]) -> None:
    takes(4)
    few, none_left = Computer(4), Computer(4)
    with helped_by(lambda: few):
        run(tmp_path / "some left")
    takes(6)
    with helped_by(lambda: none_left):
        run(tmp_path / "none left")
    assert few.counts == [2] and few.calls[0].was_ended and not none_left.calls


@pytest.mark.parametrize("works", [0, 3])
def test_helper_is_waited_for_as_long_as_it_works(tmp_path: Path, takes: Callable[[int], None], works: int) -> None:
    takes(1)
    helper, seen = Computer(1, works), list[int]()
    with helped_by(lambda: helper):
        run(tmp_path, watch=lambda: seen.append(helper.calls[0].left))
    # Once after the process here has ended, and at the end.
    assert len(seen) == works + 2 and helper.calls[0].was_ended


def test_error_here_ends_helpers(tmp_path: Path, takes: Callable[[int], None]) -> None:
    takes(1)
    helper = Computer(1, works=1_000)

    def fail() -> None:
        if helper.calls:
            raise CameraError("The photos do not overlap.")

    with helped_by(lambda: helper), pytest.raises(CameraError, match="do not overlap"):
        run(tmp_path, watch=fail)
    assert helper.calls[0].was_ended


def test_stop_ends_helpers(tmp_path: Path, takes: Callable[[int], None]) -> None:
    takes(1)
    helper = Computer(1, works=1_000)
    with helped_by(lambda: helper), pytest.raises(Cancelled, match="Stopped while counting"):
        run(tmp_path, should_stop=lambda: bool(helper.calls))
    assert helper.calls[0].was_ended
