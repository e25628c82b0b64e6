"""The cases of training as the second table: expectation, floor, what came of it, guards, verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .training_cases import TrainingCase
from .training_floors import HOLES, SAME, SIMILAR
from .training_measure import TrainingFinding

__all__ = ["TITLE", "TrainingRow", "judge_training", "training_markdown"]

TITLE = "# Stability of training"

_HEAD = ("case", "what", "expected", "least PSNR", "rule", "found", "PSNR", "guards", "verdict")


@dataclass(frozen=True)
class TrainingRow:
    """A case, what came of it, and the verdict.

    Attributes
    ----------
    case : TrainingCase
    finding : TrainingFinding
    floor : float or None
        Least PSNR, dB; None for a case that need not finish.
    green : bool
    """

    case: TrainingCase
    finding: TrainingFinding
    floor: float | None
    green: bool


def judge_training(case: TrainingCase) -> TrainingRow:
    """Run one case. What is wrong with its ending, sentence and PSNR joins the problems of its finding."""
    finding = case.run()
    floor = None if case.floor is None else case.floor.value()
    problems = list(finding.problems)
    if finding.ending != case.expected and (finding.ending, case.expected) != ("warns", "finishes"):
        problems.append(f"it {_verb(finding.ending)}{': ' * bool(finding.said)}{finding.said}")
    elif case.sentence:
        kind, _, words = case.sentence.partition("…")
        if not finding.said.startswith(kind) or words not in finding.said:
            problems.append(f"said is: {finding.said}")
    if floor is not None and finding.psnr is not None and not finding.psnr >= floor:
        problems.append(f"{finding.psnr:.2f} dB, less than {floor:.2f}")
    finding = TrainingFinding(finding.ending, finding.psnr, finding.said, finding.guards, tuple(problems))
    return TrainingRow(case, finding, floor, not problems)


def training_markdown(rows: Sequence[TrainingRow]) -> str:
    """Return the table as Markdown; PSNR in whole dB and counts in one digit, which another processor leaves alone."""
    n_red = sum(not row.green for row in rows)
    lines = [
        TITLE,
        "",
        f"{len(rows)} cases, {n_red} red. Twelve photos of 48 x 36 pixels of a scene that is known exactly, through "
        "`cameras.normalise` and `training.start` to `training.loop`. Each case says beforehand whether training "
        "`finishes`, then with which PSNR at least on the photos held out; finishes and `warns` of a poor result; or "
        "is `refused`, then with which sentence. Whatever the case, no checkpoint, read each time one is written, and "
        "no scene holds a value that is not finite. `guards` counts, over all steps, the Gaussians whose values were "
        "kept where float32 works.",
        "",
        "Rules of the least PSNR: `flat`: one flat colour, the mean of the photos trained on. `undisturbed - d`: the "
        f"first case, in the same run of the suite, less d dB ({SAME:g} where in exact arithmetic it is the same run, "
        f"{SIMILAR:g} where other Gaussians start or other random numbers are drawn, {HOLES:g} where a lack of texture "
        "leaves holes, none where less is to be learnt; `without points` where the case has none). `known`: the "
        "Gaussians that the photos are of, through the wrong cameras, or `flat`, if that is more.",
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
    expected = f'{case.expected}, "{case.sentence}"' if case.sentence else case.expected
    return [
        f"`{case.name}`",
        case.what,
        expected,
        "" if row.floor is None else f"{row.floor:.0f}",
        "" if case.floor is None else case.floor.rule,
        finding.ending,
        "" if finding.psnr is None else f"{finding.psnr:.0f}",
        _told(finding.guards),
        "green" if row.green else "**red**",
    ]


def _told(guards: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {float(f'{count:.0e}'):.0f}" for name, count in sorted(guards.items()) if count)


def _verb(ending: str) -> str:
    return "is refused" if ending == "refused" else ending
