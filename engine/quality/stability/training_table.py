"""Second table, of training: expectation, lowest acceptable PSNR, result, guards and verdict of each case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .training_cases import TrainingCase
from .training_floors import OVERFIT_DB, SAME_RUN_DB, SIMILAR_RUN_DB, UNTEXTURED_DB
from .training_measure import TrainingFinding

TITLE = "# Stability of training"

_HEAD = ("case", "what", "expected", "lowest PSNR", "rule", "found", "PSNR", "guards", "verdict")


@dataclass(frozen=True)
class TrainingRow:
    """A case with its result and verdict.

    Attributes
    ----------
    case : TrainingCase
    finding : TrainingFinding
    floor : float or None
        Lowest acceptable PSNR in dB; None for a case that need not finish.
    green : bool
    """

    case: TrainingCase
    finding: TrainingFinding
    floor: float | None
    green: bool


def run_training_case(case: TrainingCase) -> TrainingRow:
    """Run one case. Unexpected endings, messages and PSNR values are added to the problems of its finding."""
    finding = case.run()
    floor = None if case.floor is None else case.floor.value()
    problems = list(finding.problems)
    if finding.ending != case.expected and (finding.ending, case.expected) != ("warns", "finishes"):
        problems.append(f"training {_verb(finding.ending)}{': ' * bool(finding.message)}{finding.message}")
    elif case.message:
        kind, _, words = case.message.partition("…")
        if not finding.message.startswith(kind) or words not in finding.message:
            problems.append(f"unexpected message: {finding.message}")
    if floor is not None and finding.psnr is not None and not finding.psnr >= floor:
        problems.append(f"{finding.psnr:.2f} dB, less than {floor:.2f}")
    finding = TrainingFinding(finding.ending, finding.psnr, finding.message, finding.guards, tuple(problems))
    return TrainingRow(case, finding, floor, not problems)


def training_markdown(rows: Sequence[TrainingRow]) -> str:
    """Return the table as Markdown. PSNR is rounded to whole dB and counts to one digit."""
    n_red = sum(not row.green for row in rows)
    lines = [
        TITLE,
        "",
        f"{len(rows)} cases, {n_red} red. Twelve photos of 48 x 36 pixels of a known scene go through "
        "`cameras.normalise`, `training.start` and `training.loop`. Each case expects that training `finishes` with at "
        "least the lowest PSNR on the held-out photos, that it finishes and `warns` of a poor result, or that it is "
        "`refused` with a certain message. In every case, no checkpoint (each is read when it is written) and no scene "
        "may contain a value that is not finite. `guards` counts, over all steps, the Gaussians whose values were "
        "clamped to the range in which float32 works.",
        "",
        "Rules for the lowest PSNR: `flat`: one flat colour, the mean of the training photos. `undisturbed - d`: the "
        f"first case, in the same run of the suite, less d dB ({SAME_RUN_DB:g} if the run is the same in exact "
        f"arithmetic, {SIMILAR_RUN_DB:g} if initial Gaussians or random numbers differ, {UNTEXTURED_DB:g} if a lack of "
        f"texture leaves holes, {OVERFIT_DB:g} if the Gaussians have more values than the training photos, none if "
        "there is less to learn; `without points` if the case has no sparse points). `known`: the true Gaussians seen "
        "through the wrong cameras, or `flat` if that is higher.",
        "",
        "| " + " | ".join(_HEAD) + " |",
        "|" + " --- |" * len(_HEAD),
        *(f"| {' | '.join(_cells(row))} |" for row in rows),
    ]
    red = [row for row in rows if not row.green]
    if red:
        lines += ["", "## Red in training", ""]
        lines += [f"- `{row.case.name}`: {'; '.join(row.finding.problems)}" for row in red]
    return "\n".join(lines) + "\n"


def _cells(row: TrainingRow) -> list[str]:
    case, finding = row.case, row.finding
    expected = f'{case.expected}, "{case.message}"' if case.message else case.expected
    return [
        f"`{case.name}`",
        case.what,
        expected,
        "" if row.floor is None else f"{row.floor:.0f}",
        "" if case.floor is None else case.floor.rule,
        finding.ending,
        "" if finding.psnr is None else f"{finding.psnr:.0f}",
        _format_guards(finding.guards),
        "green" if row.green else "**red**",
    ]


def _format_guards(guards: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {float(f'{count:.0e}'):.0f}" for name, count in sorted(guards.items()) if count)


def _verb(ending: str) -> str:
    return "is refused" if ending == "refused" else ending
