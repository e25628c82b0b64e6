"""Shares are called here and on helpers; what a helper loses or cannot do is called again."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

from engine.core import shares
from engine.core.errors import CameraError, Cancelled
from engine.core.events import never_stop
from engine.core.shares import Arguments, Need, divided, helped_by, run_shares

ONE_CORE = Need(cores=1, memory=100)


class Called:
    """Shares that have ended, with their results."""

    def __init__(self, results: list[Any] | None, *, finished: bool = True) -> None:
        self._results, self.finished = results, finished
        self.was_ended = False

    def results(self) -> list[Any] | None:
        return self._results

    def end(self) -> Any:
        self.was_ended = True
        return self._results[0] if self._results else None


class Computer:
    """A helper with some cores, free as often as it has answers."""

    def __init__(self, cores: int, *answers: Callable[[list[int]], Called]) -> None:
        self._cores, self._answers = cores, list(answers)
        self.calls: list[Called] = []

    def free(self) -> Sequence[Computer]:
        return [self] if len(self.calls) < len(self._answers) else []

    def places(self, need: Need) -> int:
        return self._cores // need.cores

    def begin(self, function: str, given: Sequence[Arguments], need: Need, *, what: str) -> Called:
        self.calls.append(self._answers[len(self.calls)]([one["number"] for one in given]))
        return self.calls[-1]


def doubled(numbers: list[int]) -> Called:
    return Called([2 * number for number in numbers])


def lost(numbers: list[int]) -> Called:
    return Called(None)


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The shares that this computer calls, which double a number and fail at 13."""
    called: list[int] = []

    @contextlib.contextmanager
    def child_beside(function: str, arguments: Arguments, *, what: str) -> Iterator[Any]:
        if arguments["number"] == 13:
            raise CameraError("The photos do not overlap.")
        called.append(arguments["number"])
        yield doubled([arguments["number"]])

    monkeypatch.setattr(shares, "child_beside", child_beside)
    return called


def run(count: int, *, should_stop: Callable[[], bool] = never_stop, processes: int = 1) -> dict[int, Any]:
    results: dict[int, Any] = {}
    run_shares(
        "work:double", [lambda number=number: {"number": number} for number in range(count)], ONE_CORE,
        what="doubling", processes=processes, finished=results.__setitem__, should_stop=should_stop,
    )  # fmt: skip
    return results


def test_without_helpers_each_process_gets_one_share_and_there_are_no_small_ones() -> None:
    items = list(range(100))
    assert [len(one) for one in divided(items, 3, ONE_CORE, least=10)] == [33, 33, 34]
    assert [len(one) for one in divided(items, 16, ONE_CORE, least=40)] == [50, 50]
    assert [len(one) for one in divided(items, 16, ONE_CORE, least=1, most=2)] == [50, 50]
    assert divided(items[:3], 16, ONE_CORE, least=40) == [items[:3]]
    assert sum(divided(items, 7, ONE_CORE, least=1), []) == items


def test_with_helpers_there_are_three_shares_for_each_place() -> None:
    with helped_by(lambda: Computer(4, doubled)):
        assert len(divided(range(1000), 2, ONE_CORE, least=10)) == 18
        assert len(divided(range(1000), 2, Need(cores=4, memory=100), least=10)) == 9


def test_every_share_is_called_once_here_or_on_a_helper(here: list[int]) -> None:
    helper = Computer(2, doubled, doubled)
    with helped_by(lambda: helper):
        assert run(6) == {number: 2 * number for number in range(6)}
    assert len(here) == 2 and len(helper.calls) == 2
    assert run(3, processes=2) == {0: 0, 1: 2, 2: 4}


def test_shares_that_a_helper_lost_are_called_again(here: list[int]) -> None:
    helper = Computer(2, lost)
    with helped_by(lambda: helper):
        assert run(4) == {number: 2 * number for number in range(4)}
    assert sorted(here) == [0, 1, 2, 3] and helper.calls[0].was_ended


def test_error_here_ends_the_shares_of_helpers(here: list[int]) -> None:
    helper = Computer(12, lambda numbers: Called(None, finished=False))
    with helped_by(lambda: helper), pytest.raises(CameraError, match="do not overlap"):
        run(20)
    assert helper.calls[0].was_ended


def test_stop_ends_all_shares(here: list[int]) -> None:
    helper = Computer(2, lambda numbers: Called(None, finished=False))
    with helped_by(lambda: helper), pytest.raises(Cancelled, match="Stopped while doubling"):
        run(4, should_stop=lambda: len(here) == 2)
    assert helper.calls[0].was_ended
