"""Work that is done one item ahead gives the results, and the errors, of work in order."""

from __future__ import annotations

import threading

import pytest

from engine.core.prefetch import prefetched


def test_results_come_in_order_and_are_made_while_the_one_before_is_used() -> None:
    made = [threading.Event() for _ in range(4)]

    def work(number: int) -> int:
        made[number].set()
        return number * number

    found = []
    for number, square in enumerate(prefetched(work, range(4))):
        # The limit only guards against hanging.
        assert made[min(number + 1, 3)].wait(60)
        found.append(square)
    assert found == [0, 1, 4, 9]
    assert list(prefetched(work, [])) == []


def test_error_of_an_item_is_raised_in_its_place() -> None:
    found = []
    with pytest.raises(ZeroDivisionError):
        for value in prefetched(lambda number: 6 // number, [3, 2, 0, 1]):
            found.append(value)
    assert found == [2, 3]
