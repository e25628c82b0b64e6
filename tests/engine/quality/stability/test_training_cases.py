"""Training in stiff and extreme cases ends as expected, and the committed table says the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.quality.stability.cases import CASES
from engine.quality.stability.training_cases import TRAINING_CASES, TrainingCase
from engine.quality.stability.training_table import TITLE, TrainingRow, training_markdown

DOCS = Path(__file__).resolve().parents[4] / "docs" / "stability.md"


@pytest.mark.parametrize("case", TRAINING_CASES, ids=lambda case: case.name)
def test_training_ends_as_expected(case: TrainingCase, training_rows: dict[str, TrainingRow]) -> None:
    row = training_rows[case.name]
    assert row.green, row.finding


def test_names_are_unique_in_both_tables() -> None:
    names = [case.name for case in (*CASES, *TRAINING_CASES)]
    assert len(set(names)) == len(names)


def test_every_case_has_a_floor_or_a_message() -> None:
    for case in TRAINING_CASES:
        assert (case.floor is not None) == (case.expected == "finishes"), case.name
        assert bool(case.message) == (case.expected != "finishes"), case.name


def test_an_undisturbed_run_needs_no_guard_and_an_extreme_run_shows_which_acted(
    training_rows: dict[str, TrainingRow],
) -> None:
    assert not any(training_rows["undisturbed"].finding.guards.values())
    assert training_rows["start_means_1e30"].finding.guards["clamped_positions"] >= 3
    assert "clamped_positions 3" in training_markdown([training_rows["start_means_1e30"]])


def test_no_floor_is_too_low_to_fail(training_rows: dict[str, TrainingRow]) -> None:
    for row in training_rows.values():
        assert row.floor is None or row.floor > 5.0, row


def cells(text: str) -> list[tuple[str, ...]]:
    """Return case, description, expectation, rule, ending and verdict of each row; figures may differ."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("| `")]
    return [(*row[:3], row[4], row[5], row[-1]) for row in rows]


def test_committed_table_says_what_the_suite_says_now(training_rows: dict[str, TrainingRow]) -> None:
    """If it fails: run `make stability` and commit docs/stability.md."""
    committed = DOCS.read_text(encoding="utf-8").partition("\n" + TITLE)[2]
    assert cells(committed) == cells(training_markdown(list(training_rows.values())))
