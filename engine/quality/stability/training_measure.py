"""Measurement of one training run: its ending, PSNR, clamped values, and stored values that are not finite."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ...core.errors import FormatError, HeritageError
from ...core.events import Event, StopCheck, Warned, ignore_events, never_stop
from ...core.files import ArraySpec, parse_json, read_arrays
from ...scene import Gaussians
from ...training import CHECKPOINT_FILE, TrainingResult, save_gaussians, train
from ...training.settings import TrainingSettings
from .training_scenes import TrainingInput

_STORED = ArraySpec("float32|int32|bool")
Ending = Literal["finishes", "warns", "refused"]


@dataclass(frozen=True)
class TrainingFinding:
    """Result of one case of training.

    Attributes
    ----------
    ending : {"finishes", "warns", "refused"}
        ``warns``: training finishes with a warning that the result is poor.
    psnr : float or None
        PSNR of the result on the held-out photos in dB; None if there is no result.
    message : str
        Message of the error or warning. An error's type comes first, with a colon.
    guards : mapping of str to int
        Number of values that each guard and each limit clamped.
    problems : tuple of str
        Faults that no case may have, such as stored values that are not finite; a clause each.
    """

    ending: Ending
    psnr: float | None = None
    message: str = ""
    guards: Mapping[str, int] = field(default_factory=dict)
    problems: tuple[str, ...] = ()


class CheckpointMonitor:
    """Stop check that reads every checkpoint when it is written and collects its problems.

    Parameters
    ----------
    folder : Path
        Folder of the checkpoints.
    should_stop : StopCheck
        Decides whether the run stops.

    Attributes
    ----------
    problems : list of str
    """

    def __init__(self, folder: Path, should_stop: StopCheck = never_stop) -> None:
        self.problems: list[str] = []
        self._file, self._should_stop = folder / CHECKPOINT_FILE, should_stop
        self._last_read: int | None = None

    def __call__(self) -> bool:
        """Read the checkpoint if it has changed, then return whether to stop."""
        if self._file.is_file() and (modified := self._file.stat().st_mtime_ns) != self._last_read:
            self._last_read = modified
            self.problems += non_finite_values(self._file.parent)
        return self._should_stop()


def run_training(
    inputs: TrainingInput, settings: TrainingSettings, folder: Path, should_stop: StopCheck
) -> TrainingResult:
    """Train with checkpoints in `folder` and return the result."""
    return train(inputs.start, inputs.views, settings, checkpoints=folder, emit=ignore_events, should_stop=should_stop)


def measure_training(
    make: Callable[[], tuple[TrainingInput, TrainingSettings]],
    check: Callable[[TrainingResult, TrainingSettings], list[str]] = lambda result, settings: [],
) -> TrainingFinding:
    """Train once and measure the run.

    Parameters
    ----------
    make : callable
        Returns input and settings. Making the input may itself be refused.
    check : callable
        Returns further problems of a result.
    """
    events: list[Event] = []
    with tempfile.TemporaryDirectory() as name:
        monitor = CheckpointMonitor(folder := Path(name))
        try:
            inputs, settings = make()
            result = train(
                inputs.start, inputs.views, settings, checkpoints=folder, emit=events.append, should_stop=monitor
            )
            save_gaussians(folder, result.gaussians)
        except HeritageError as error:
            return replace(refusal_finding(error), problems=tuple(monitor.problems + non_finite_values(folder)))
        problems = (
            monitor.problems + non_finite_values(folder) + _count_problems(result, settings) + check(result, settings)
        )
    poor = [event.message for event in events if isinstance(event, Warned) and "flat colour" in event.message]
    return TrainingFinding(
        "warns" if poor else "finishes",
        result.curve[-1].psnr,
        "".join(poor),
        {**result.figures["guards"], **result.figures["limits"]},
        tuple(dict.fromkeys(problems)),
    )


def refusal_finding(error: HeritageError) -> TrainingFinding:
    """Return the finding of a run that ended with `error`, whose message must be sentences on one line."""
    problems = [] if error.exit_code != 0 else ["the exit code is 0"]
    if "\n" in str(error) or not str(error).endswith("."):
        problems.append(f"the error is not a sentence: {error}")
    return TrainingFinding("refused", message=f"{type(error).__name__}: {error}", problems=tuple(problems))


def same_gaussians(first: Gaussians, second: Gaussians) -> bool:
    """Return whether all arrays are exactly equal."""
    pairs = [(getattr(first, f.name), getattr(second, f.name)) for f in dataclasses.fields(first)]
    return all((a is None and b is None) or np.array_equal(a, b) for a, b in pairs)


def non_finite_values(folder: Path) -> list[str]:
    """Return the arrays of the checkpoint in `folder` that are not finite, one clause each; none without a checkpoint.

    A scene that is not finite is no finding of this function: `save_gaussians` refuses it.
    """
    file = folder / CHECKPOINT_FILE
    if not file.is_file():
        return []
    try:
        stored = read_arrays(file, {"record": ArraySpec("str", ())}, optional={"*": _STORED}, advice="")
        step = parse_json(str(stored.pop("record")), {"step": int}, source=str(file), advice="")["step"]
    except FormatError as error:
        return [str(error).strip()]
    bad = [name for name, values in stored.items() if not np.isfinite(values).all()]
    return [f"`{name}` of the checkpoint at step {step} is not finite" for name in bad]


def _count_problems(result: TrainingResult, settings: TrainingSettings) -> list[str]:
    largest = max(point.n_gaussians for point in result.curve)
    if largest > settings.growth.max_gaussians:
        return [f"{largest} Gaussians, {settings.growth.max_gaussians} are allowed"]
    return []
