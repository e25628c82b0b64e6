"""Every stiff or extreme case ends as expected, and the committed table says the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from engine.quality.stability.bounds import BOUNDS, DEFAULT
from engine.quality.stability.cases import CASES, Case
from engine.quality.stability.table import Row, suite_markdown
from engine.quality.stability.training_table import TITLE

DOCS = Path(__file__).resolve().parents[4] / "docs" / "stability.md"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case_ends_as_expected(case: Case, rows: dict[str, Row]) -> None:
    row = rows[case.name]
    assert row.green, f"expected {case.expected}, found {row.finding}"


def test_case_names_are_unique_and_bounds_belong_to_cases() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert set(BOUNDS) <= set(names)


def test_every_bound_that_is_not_the_default_has_its_reason() -> None:
    for name, bounds in BOUNDS.items():
        assert bounds != DEFAULT, name
        assert len(bounds.reason) > 20, name


def verdicts(text: str) -> list[tuple[str, ...]]:
    """Return case, description, expectation, outcome and verdict of each row; figures may differ."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("| `")]
    return [(*row[:4], row[-1]) for row in rows]


def test_committed_table_says_what_the_suite_says_now(rows: dict[str, Row]) -> None:
    """If it fails: run `make stability` and commit docs/stability.md."""
    committed = DOCS.read_text(encoding="utf-8").partition("\n" + TITLE)[0]
    now = suite_markdown(list(rows.values()))
    assert verdicts(committed) == verdicts(now)
    assert "python -m engine stability --out docs/stability.md" in committed
    _, _, reasons_now = now.partition("## Bounds")
    assert committed.partition("## Bounds")[2] == reasons_now
