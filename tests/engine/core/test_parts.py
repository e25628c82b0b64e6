"""Where the time of a command went."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from engine.core import parts
from engine.core.parts import measured_parts, part


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """A clock that stands still; its first number is the time, and so are the CPU seconds."""
    now = [0.0]
    monkeypatch.setattr(parts.time, "perf_counter", lambda: now[0])
    yield now


def test_every_second_is_told_once_and_of_the_innermost_part(clock: list[float]) -> None:
    with measured_parts(lambda: 2 * clock[0]) as account:
        clock[0] += 1
        with part("training"):
            clock[0] += 2
            with part("writing"):
                clock[0] += 4
            clock[0] += 8
        with part("training"):
            clock[0] += 16
    assert account.as_json() == {"": [1, 2], "training": [26, 52], "training/writing": [4, 8]}


def test_imports_that_import_are_one_part(clock: list[float]) -> None:
    with measured_parts(lambda: 0.0) as account, part("imports"):
        clock[0] += 1
        with part("imports"):
            clock[0] += 2
    assert account.as_json() == {"": [0, 0], "imports": [3, 0]}


def test_part_that_fails_is_told_too(clock: list[float]) -> None:
    with measured_parts(lambda: 0.0) as account:
        with pytest.raises(ValueError), part("report"):
            clock[0] += 1
            raise ValueError
        clock[0] += 2
    assert account.as_json() == {"": [2, 0], "report": [1, 0]}


def test_other_threads_do_not_disturb_the_account() -> None:
    def work() -> None:
        with part("elsewhere"):
            pass

    with measured_parts(lambda: 0.0) as account, part("training"):
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    assert set(account.as_json()) == {"", "training"}
