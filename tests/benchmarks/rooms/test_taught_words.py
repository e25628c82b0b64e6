"""Words taught in one room and asked in another are counted as they are answered."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.rooms.taught_words import Measured, asked, pictures_table, taught, taught_table
from engine.objects import Looks


class Axes:
    """Knows the kinds as axes: a mask, a bell, and what is neither; calls a bell by no other word."""

    name = "axes"

    def check_prompt(self, prompt: str) -> Any:
        return SimpleNamespace(known=False)

    def example_vectors(self, described: Any) -> Any:
        return described

    def score_examples(self, described: Any, means: Any) -> Any:
        return described @ means.T

    def score_descriptions(self, described: Any, prompt: str) -> list[float]:
        return [float(score) for score in described[:, ["mask", "bell", "radio"].index(prompt)]]

    def score_vocabulary(self, described: Any) -> Any:
        return np.full((len(described), 99), 0.3, np.float32)

    def fitting_word(self, described: Any, prompt: str) -> str:
        return "gong" if prompt == "bell" and described[:, 2].max() > 0 else ""


def room(name: str, **shown: list[float]) -> Measured:
    """Return a room whose exhibits look as they are told, each with one proposal."""
    rows = np.array(list(shown.values()), np.float32)
    count = len(rows)
    looks = Looks(
        np.eye(count, dtype=bool), np.full(count, 4, np.float32), np.arange(count, dtype=np.int32),
        np.arange(count, dtype=np.int32), ("",) * count, np.zeros((count, 2, 2), np.float32), rows,
    )  # fmt: skip
    truth = SimpleNamespace(objects=tuple(shown), prompts={one: one for one in shown}, ignored=())
    return Measured(name, truth, looks, np.eye(count, dtype=np.float32), rows, np.arange(count))  # type: ignore[arg-type]


@pytest.fixture
def rooms() -> list[Measured]:
    return [
        room("first", mask=[0.9, 0.0, 0.0], bell=[0.0, 0.9, 0.0]),
        room("second", mask=[0.9, 0.0, 0.0], radio=[0.0, 0.0, 0.9]),
    ]


def test_kinds_are_asked_in_the_rooms_that_did_not_teach_them(rooms: list[Measured]) -> None:
    found = {(name, kind): (shown, share, refused) for name, kind, shown, share, refused in
             taught(rooms, 1, Axes(), alone=True, knowing=False)}  # type: ignore[arg-type]  # fmt: skip
    assert found["first", "mask"] == found["second", "mask"] == (True, 1.0, 0.0)
    # Each room shows a kind that the other room lacks and nothing there resembles.
    assert found["second", "bell"] == (False, 0.0, 1.0) and found["first", "radio"] == (False, 0.0, 1.0)
    assert len(found) == 4, "a kind that only this room shows was taught nowhere"
    lines = taught_table(rooms, Axes()).splitlines()  # type: ignore[arg-type]
    assert lines[2] == "| 1 | none | not used | 2 | 100 % | 0 % | 0 % | 2 | 100 % |"


def test_kind_that_a_room_resembles_is_not_asked_as_an_absent_one() -> None:
    assert room("one", gong=[0, 1, 0]).shows_like("bell") and not room("one", radio=[0, 1, 0]).shows_like("bell")
    assert room("one", radio=[0, 1, 0]).shows_like("no kind of the catalogue")


def test_what_the_detector_takes_for_something_else_is_no_answer() -> None:
    one = room("one", bell=[0.0, 0.9, 0.5])
    scores = np.array([0.9])
    assert asked(one, scores, "bell") is True and asked(one, scores, "bell", Axes()) is None  # type: ignore[arg-type]
    assert pictures_table([one], Axes()).splitlines()[2] == "| one | 1 | 1 | 0 | 0 | 1 | 1 | 1 | 1 |"  # type: ignore[arg-type]
