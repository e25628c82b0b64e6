"""Threads that decode photos share one budget of memory."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from engine.core.errors import PhotoError
from engine.photos.memory_budget import MemoryBudget


@pytest.fixture
def budget(monkeypatch: pytest.MonkeyPatch) -> MemoryBudget:
    """A budget of 300 bytes."""
    monkeypatch.setattr("engine.photos.memory_budget.free_memory", lambda: 400)
    return MemoryBudget(always=50)


def test_sum_of_all_threads_stays_within_the_budget(budget: MemoryBudget) -> None:
    used, largest, lock = 0, 0, threading.Lock()

    def work(n_bytes: int) -> None:
        nonlocal used, largest
        with budget.reserved(n_bytes, "a.png"):
            with lock:
                used += n_bytes
                largest = max(largest, used)
            threading.Event().wait(0.001)
            with lock:
                used -= n_bytes

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, [100, 290, 20, 150, 149] * 20))
    assert 100 < largest <= 300
    assert used == 0


def test_too_large_a_photo_is_refused_with_need_and_limit(budget: MemoryBudget) -> None:
    refused = pytest.raises(
        PhotoError, match=r"^a\.png has many pixels, which takes 0\.0 GB of memory to read; at most"
    )
    with refused, budget.reserved(301, "a.png has many pixels"):
        pass
    with budget.reserved(300, "a.png"):
        pass


def test_small_photo_is_never_refused(monkeypatch: pytest.MonkeyPatch, budget: MemoryBudget) -> None:
    monkeypatch.setattr("engine.photos.memory_budget.free_memory", lambda: 0)
    with budget.reserved(50, "a.png"):
        pass


def test_memory_is_given_back_after_an_error(budget: MemoryBudget) -> None:
    with pytest.raises(ValueError, match="damaged"), budget.reserved(300, "a.png"):
        raise ValueError("damaged")
    with budget.reserved(300, "a.png"):
        pass
