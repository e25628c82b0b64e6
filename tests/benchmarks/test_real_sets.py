"""The table of real sets says of every object what a mask, a click, its word and a search for all objects give."""

from __future__ import annotations

from benchmarks.real_sets import Row, table


def row(photo_set: str, thing: str, column: str, iou: float, holes: float = 2.0) -> Row:
    return Row(photo_set, thing, column, iou, iou - 10, 1.0, 0.5, holes, 6, 0.1)


def test_found_and_whole_objects_are_counted_and_an_object_without_a_word_is_none() -> None:
    rows = [
        row("a", "skull", "better", 90.0, holes=4.0), row("a", "skull", "click", 40.0), row("a", "skull", "word", 0.0),
        row("b", "door", "better", 80.0), row("b", "door", "click", 60.0), row("b", "door", "word", 86.0),
        row("b", "bananas", "better", 90.0), row("b", "bananas", "click", 100.0), row("b", "bananas", "word", 30.0),
    ]  # fmt: skip
    lines = table(rows, ["better", "click", "word"]).splitlines()
    assert lines[2] == "| a | skull | 6 | 90.0 / 80.0 | 40.0 / 30.0 | no word | 1.0 | 0.5 | 4.0 |"
    # Each set has the same weight, and a set without a word has none.
    assert lines[-2] == "| **mean of the sets** | | | 87.5 / 77.5 | 60.0 / 50.0 | 58.0 / 48.0 | | | |"
    assert lines[-1] == "| **found, whole** | | | 3, 2 of 3 | 2, 1 of 3 | 1, 1 of 2 | | | |"
    assert {line.count("|") for line in lines} == {10}
