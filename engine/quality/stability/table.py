"""Running of cases, and Markdown tables with a verdict for each case and the reasons of unusual bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import Cancelled, SettingsError
from ...core.events import Emit, Progress, StopCheck
from ...core.files import write_file
from ...install.models import one_thread
from .bounds import BOUNDS, DEFAULT, bounds_of
from .cases import CASES, Case
from .measure import Finding
from .training_cases import TRAINING_CASES, TrainingCase
from .training_table import TrainingRow, run_training_case, training_markdown

COMMAND = "python -m engine stability --out docs/stability.md"

_HEAD = ("case", "what", "expected", "found", "forward", "flips", "gradient", "condition", "in roundings", "verdict")


@dataclass(frozen=True)
class Row:
    """A case with its result and verdict.

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


def select_cases(name: str | None) -> tuple[AnyCase, ...]:
    """Return the case of this name, or for None all cases, with those of training at the end.

    Raises
    ------
    SettingsError
        When no case has this name.
    """
    cases: tuple[AnyCase, ...] = (*CASES, *TRAINING_CASES)
    selected = tuple(case for case in cases if name is None or case.name == name)
    if not selected:
        raise SettingsError(f"There is no case {name!r}. The cases are {', '.join(case.name for case in cases)}.")
    return selected


def run_case(case: AnyCase) -> AnyRow:
    """Run one case with one thread of torch. A row is green if the outcome is as expected and no bound is exceeded."""
    if isinstance(case, TrainingCase):
        return run_training_case(case)
    with one_thread():  # More threads change the order of sums.
        finding = case.run(bounds_of(case.name))
    return Row(case, finding, finding.outcome == case.expected and not finding.problems)


def run_cases(cases: Sequence[AnyCase], *, emit: Emit, should_stop: StopCheck) -> list[AnyRow]:
    """Return a row for each case.

    Raises
    ------
    Cancelled
        When `should_stop` returns true between two cases.
    """
    rows = []
    for i, case in enumerate(cases):
        if should_stop():
            raise Cancelled("The numerical suite was stopped; nothing was written.")
        rows.append(run_case(case))
        emit(Progress("stability", (i + 1) / len(cases), message=case.name))
    return rows


def suite_markdown(rows: Sequence[AnyRow]) -> str:
    """Return the tables of float32 errors and of training as Markdown, without a table that has no rows."""
    errors = [row for row in rows if isinstance(row, Row)]
    training = [row for row in rows if isinstance(row, TrainingRow)]
    tables = ([_errors_markdown(errors)] if errors else []) + ([training_markdown(training)] if training else [])
    return "\n".join(tables)


def _errors_markdown(rows: Sequence[Row]) -> str:
    """Return the first table. Figures are rounded to one digit, so that only a substantial change alters a row."""
    n_red = sum(not row.green for row in rows)
    lines = [
        "# Numerical suite",
        "",
        f"`{COMMAND}`",
        "",
        f"{len(rows)} cases, {n_red} red. The float32 `cpu` backend is compared with float64 (`reference`). "
        f"Bounds: forward <= {DEFAULT.forward:g} (of the largest blended value, at least 1) without flips; gradient "
        f"error <= {DEFAULT.gradient:g} roundings, where a rounding is 2^-23 times the condition number. "
        "A flip is a pixel that is within 1e-5 of a threshold in float64 and decides it differently in float32; "
        "`flips` counts them and, after the slash, all pixels so near to a threshold. `gradient` is |error| / "
        "|gradient| (norms of rows) of the worst Gaussian, with the name of the array and the condition number "
        "(`engine/quality/stability/condition.py`). Cases marked * have a bound that is not the default, with the "
        "reason below the table.",
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
        lines += [f"- `{row.case.name}`: {'; '.join(row.finding.problems) or 'unexpected outcome'}" for row in red]
    return "\n".join(lines) + "\n"


def write_table(path: Path, rows: Sequence[AnyRow]) -> None:
    """Write `suite_markdown` of the rows to `path`, atomically."""
    write_file(path, suite_markdown(rows))


def _cells(row: Row) -> list[str]:
    case, finding = row.case, row.finding
    star = "*" if case.name in BOUNDS else ""
    gradient = finding.gradient
    cells = ["", "", ""]
    if gradient is not None and not gradient.array:
        cells = ["exact", "", "0"]
    elif gradient is not None and gradient.condition > 1e12:
        # The true gradient consists of float64 rounding only, so there is no relative error.
        cells = [f"of 0 ({gradient.array})", "", _short(gradient.ratio)]
    elif gradient is not None:
        cells = [f"{_short(gradient.error)} ({gradient.array})", _short(gradient.condition), _short(gradient.ratio)]
    flips = f"{finding.flips}/{finding.near}" if finding.near else ("0" if gradient is not None else "")
    return [
        f"`{case.name}`{star}",
        case.what,
        case.expected,
        finding.outcome,
        "" if finding.forward is None else _short(finding.forward),
        flips,
        *cells,
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
