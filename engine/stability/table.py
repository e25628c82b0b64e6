"""Runs cases and lays them out as Markdown tables with a verdict for each, and the reasons of unusual bounds below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from ..errors import Cancelled, SettingsError
from ..events import Emit, Progress, StopCheck
from ..project_folder import atomic_write
from .bounds import BOUNDS, DEFAULT, bounds_of
from .cases import CASES, Case
from .measure import Finding
from .training_cases import TRAINING_CASES, TrainingCase
from .training_table import TrainingRow, judge_training, training_markdown

__all__ = ["COMMAND", "Row", "judge", "markdown", "run_cases", "select", "write_table"]

COMMAND = "python -m engine stability --out docs/stability.md"

_HEAD = ("case", "what", "expected", "found", "forward", "flips", "gradient", "condition", "in roundings", "verdict")


@dataclass(frozen=True)
class Row:
    """A case, what it came to, and the verdict.

    Attributes
    ----------
    case : Case
    finding : Finding
    green : bool
    """

    case: Case
    finding: Finding
    green: bool


AnyCase = Case | TrainingCase
AnyRow = Row | TrainingRow


def select(name: str | None) -> tuple[AnyCase, ...]:
    """Return the case of this name, or all of them for None, those of training last.

    Raises
    ------
    SettingsError
        When there is no such case.
    """
    cases: tuple[AnyCase, ...] = (*CASES, *TRAINING_CASES)
    chosen = tuple(case for case in cases if name is None or case.name == name)
    if not chosen:
        raise SettingsError(f"There is no case {name!r}; the cases are {', '.join(case.name for case in cases)}.")
    return chosen


def judge(case: AnyCase) -> AnyRow:
    """Run one case on one thread of torch. Green: the expected outcome, and nothing out of bounds."""
    if isinstance(case, TrainingCase):
        return judge_training(case)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # its threads change the order of sums, and spin
    try:
        finding = case.run(bounds_of(case.name))
    finally:
        torch.set_num_threads(threads)
    return Row(case, finding, finding.outcome == case.expected and not finding.problems)


def run_cases(cases: Sequence[AnyCase], *, emit: Emit, should_stop: StopCheck) -> list[AnyRow]:
    """Return a row for each case.

    Raises
    ------
    Cancelled
        When `should_stop` says so between two cases.
    """
    rows = []
    for i, case in enumerate(cases):
        if should_stop():
            raise Cancelled("The numerical suite was stopped; nothing was written.")
        rows.append(judge(case))
        emit(Progress("stability", (i + 1) / len(cases), message=case.name))
    return rows


def markdown(rows: Sequence[AnyRow]) -> str:
    """Return the tables of float32's errors and of training as Markdown, each if it has rows."""
    errors = [row for row in rows if isinstance(row, Row)]
    training = [row for row in rows if isinstance(row, TrainingRow)]
    tables = ([_errors_markdown(errors)] if errors else []) + ([training_markdown(training)] if training else [])
    return "\n".join(tables)


def _errors_markdown(rows: Sequence[Row]) -> str:
    """Return the first table: figures rounded to one digit, so that only a change of substance changes a row."""
    n_red = sum(not row.green for row in rows)
    lines = [
        "# Numerical suite",
        "",
        f"`{COMMAND}`",
        "",
        f"{len(rows)} cases, {n_red} red. The float32 `cpu` backend against float64 (`reference`). "
        f"Bounds: forward <= {DEFAULT.forward:g} (of the largest value blended, or 1) away from flips; gradient error "
        f"<= {DEFAULT.gradient:g} roundings, where a rounding is 2^-23 times the condition number. "
        "A flip is a pixel that lies within 1e-5 of a threshold in float64 and decided otherwise; `flips` counts them "
        "and, behind the stroke, the pixels that lie so. `gradient` is |error| / |gradient| of the worst Gaussian, "
        "normwise, with the array it belongs to and its condition number (`engine/stability/condition.py`). "
        "A bound marked * is not the default; its reason stands below.",
        "",
        "| " + " | ".join(_HEAD) + " |",
        "|" + " --- |" * len(_HEAD),
        *(f"| {' | '.join(_cells(row))} |" for row in rows),
    ]
    unusual = [row.case.name for row in rows if row.case.name in BOUNDS]
    if unusual:
        lines += ["", "## Bounds that are not the default", ""]
        lines += [f"- `{name}`: {_differences(name)}. {BOUNDS[name].reason}" for name in unusual]
    red = [row for row in rows if not row.green]
    if red:
        lines += ["", "## Red", ""]
        lines += [f"- `{row.case.name}`: {'; '.join(row.finding.problems) or 'another outcome'}" for row in red]
    return "\n".join(lines) + "\n"


def write_table(path: Path, rows: Sequence[AnyRow]) -> None:
    """Write `markdown` of the rows to `path`, atomically."""
    with atomic_write(path, "w") as file:
        file.write(markdown(rows))


def _cells(row: Row) -> list[str]:
    case, finding = row.case, row.finding
    star = "*" if case.name in BOUNDS else ""
    gradient = finding.gradient
    shown = ["", "", ""]
    if gradient is not None and not gradient.array:
        shown = ["exact", "", "0"]
    elif gradient is not None and gradient.condition > 1e12:
        # The true gradient is nothing but float64's rounding: there is no relative error.
        shown = [f"of 0 ({gradient.array})", "", _short(gradient.ratio)]
    elif gradient is not None:
        shown = [f"{_short(gradient.error)} ({gradient.array})", _short(gradient.condition), _short(gradient.ratio)]
    flips = f"{finding.flips}/{finding.near}" if finding.near else ("0" if gradient is not None else "")
    return [
        f"`{case.name}`{star}",
        case.what,
        case.expected,
        finding.outcome,
        "" if finding.forward is None else _short(finding.forward),
        flips,
        *shown,
        "green" if row.green else "**red**",
    ]


def _short(value: float) -> str:
    """Return one significant digit: 0, 3e-07, 0.4, 20, inf."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else "inf"
    return f"{float(f'{value:.0e}'):g}"


def _differences(name: str) -> str:
    bounds = bounds_of(name)
    parts = [
        f"{field} <= {getattr(bounds, field):.2g}"
        for field in ("forward", "gradient", "near", "near_share")
        if getattr(bounds, field) != getattr(DEFAULT, field)
    ]
    return ", ".join(parts)
