"""One training run of the suite: whether it finishes, how well, which guards fired, and what it left on disk."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ..errors import HeritageError
from ..events import Event, StopCheck, Warned, never_stop
from ..gaussians import load_gaussians, save_gaussians
from ..scene import Gaussians
from ..training import CHECKPOINT_FILE, TrainingResult, train
from ..training.settings import TrainingSettings
from .training_scenes import TrainingInput

__all__ = ["TrainingFinding", "Watch", "measured_run", "problems_of_files", "refused_by", "same_gaussians", "trained"]

Ending = Literal["finishes", "warns", "refused"]


@dataclass(frozen=True)
class TrainingFinding:
    """What one case of training came to.

    Attributes
    ----------
    ending : {"finishes", "warns", "refused"}
        ``warns``: it finishes and says that the result is poor.
    psnr : float or None
        Of the result on the held-out photos, dB; None when there is no result.
    said : str
        The error's or warning's sentence, an error's with its type before it.
    guards : mapping of str to int
        How often each guard and each limit kept values in bounds.
    problems : tuple of str
        Everything that is wrong whatever the case expects, as sentences.
    """

    ending: Ending
    psnr: float | None = None
    said: str = ""
    guards: Mapping[str, int] = field(default_factory=dict)
    problems: tuple[str, ...] = ()


class Watch:
    """A stop check that reads every checkpoint as it is written, and keeps what is wrong with any.

    Parameters
    ----------
    folder : Path
        Of the checkpoints.
    should_stop : StopCheck
        Asked too.

    Attributes
    ----------
    problems : list of str
    """

    def __init__(self, folder: Path, should_stop: StopCheck = never_stop) -> None:
        self.problems: list[str] = []
        self._file, self._should_stop = folder / CHECKPOINT_FILE, should_stop
        self._seen: int | None = None

    def __call__(self) -> bool:
        """Look at the checkpoint if it is another one, then ask whether to stop."""
        if self._file.is_file() and (now := self._file.stat().st_mtime_ns) != self._seen:
            self._seen = now
            self.problems += problems_of_files(self._file.parent)
        return self._should_stop()


def trained(given: TrainingInput, settings: TrainingSettings, folder: Path, should_stop: StopCheck) -> TrainingResult:
    """Return the result of training, its checkpoints in `folder`."""
    return train(
        given.start, given.views, settings, checkpoints=folder, emit=lambda event: None, should_stop=should_stop
    )


def measured_run(
    make: Callable[[], tuple[TrainingInput, TrainingSettings]],
    more: Callable[[TrainingResult, TrainingSettings], list[str]] = lambda result, settings: [],
) -> TrainingFinding:
    """Train once and return what came of it.

    Parameters
    ----------
    make : callable
        Gives the input, which may itself be refused, and the settings.
    more : callable
        Further problems of a result.
    """
    events: list[Event] = []
    with tempfile.TemporaryDirectory() as name:
        watch = Watch(folder := Path(name))
        try:
            given, settings = make()
            result = train(
                given.start, given.views, settings, checkpoints=folder, emit=events.append, should_stop=watch
            )
            save_gaussians(folder, result.gaussians)
        except HeritageError as error:
            return replace(refused_by(error), problems=tuple(watch.problems + problems_of_files(folder)))
        problems = (
            watch.problems + problems_of_files(folder) + _count_problems(result, settings) + more(result, settings)
        )
    poor = [event.message for event in events if isinstance(event, Warned) and "flat colour" in event.message]
    return TrainingFinding(
        "warns" if poor else "finishes",
        result.curve[-1].psnr,
        "".join(poor),
        {**result.figures["guards"], **result.figures["limits"]},
        tuple(dict.fromkeys(problems)),
    )


def refused_by(error: HeritageError) -> TrainingFinding:
    """Return the finding of a run that ended with `error`: one sentence or two, and an exit code that is not 0."""
    problems = [] if error.exit_code != 0 else ["the exit code is 0"]
    if "\n" in str(error) or not str(error).endswith("."):
        problems.append(f"the error is not a sentence: {error}")
    return TrainingFinding("refused", said=f"{type(error).__name__}: {error}", problems=tuple(problems))


def same_gaussians(one: Gaussians, other: Gaussians) -> bool:
    """Return whether all arrays of both are equal, bit by bit."""
    pairs = [(getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one)]
    return all((a is None and b is None) or np.array_equal(a, b) for a, b in pairs)


def problems_of_files(folder: Path) -> list[str]:
    """Return which values of checkpoint and scene in `folder` are not finite."""
    problems = []
    if (folder / CHECKPOINT_FILE).is_file():
        with np.load(folder / CHECKPOINT_FILE, allow_pickle=False) as stored:
            record = json.loads(str(stored["record"]), parse_constant=lambda word: problems.append(f"{word} in record"))
            bad = [name for name in stored.files if name != "record" and not np.isfinite(stored[name]).all()]
        problems += [f"`{name}` of the checkpoint at step {record['step']} is not finite" for name in bad]
    if (folder / "scene.ply").is_file():
        scene = load_gaussians(folder)
        for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
            if not np.isfinite(getattr(scene, name)).all():
                problems.append(f"`{name}` of the scene is not finite")
    return problems


def _count_problems(result: TrainingResult, settings: TrainingSettings) -> list[str]:
    most = max(point.n_gaussians for point in result.curve)
    if most > settings.max_gaussians:
        return [f"{most} Gaussians, {settings.max_gaussians} are allowed"]
    return []
