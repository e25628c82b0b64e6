"""Rules of training that hold to the last bit: stopped, killed or out of memory, a run ends with the same Gaussians."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from ..errors import Cancelled
from ..events import StopCheck
from ..training import Parameters, TrainingResult, render
from ..training.settings import TrainingSettings
from .starved import ENVIRONMENT
from .training_measure import TrainingFinding, Watch, same_gaussians, trained
from .training_scenes import SETTINGS, known_capture, training_input

__all__ = ["continues_exactly", "continues_without_memory", "stays_empty"]

_STOPPED_AFTER = (1, 47, 20, 35)
"""Steps that each attempt is given: it ends before the first checkpoint, between two, after growth, near the end."""


_MOST_COVERED = 0.05
"""Of the black pixels; soft edges of the balls are 1 to 2 %."""


class _Killed(BaseException):
    """Ends a run as a kill does: nothing gets to write a checkpoint."""


def continues_exactly(*, killed: bool) -> TrainingFinding:
    """Return whether a run that is stopped (or killed) four times gives the Gaussians of one that was not.

    With exposure, whose moments are part of the state too, and growth in between.
    """
    settings = replace(SETTINGS, exposure=True, max_gaussians=600)
    capture = known_capture()[0].exposed(list(np.linspace(0.7, 1.0, 12)))
    given = training_input(capture, settings)
    problems: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = trained(given, settings, folder / "whole", lambda: False)
        for steps in _STOPPED_AFTER:
            watch = Watch(folder / "again", _ends_after(steps, killed=killed))
            try:
                trained(given, settings, folder / "again", watch)
                problems.append(f"the run that was to end after {steps} steps did not")
            except (Cancelled, _Killed):
                problems += watch.problems
        again = trained(given, settings, folder / "again", lambda: False)
    if not same_gaussians(whole.gaussians, again.gaussians):
        problems.append("the Gaussians are others than those of a run that went through")
    for figure in ("psnr", "guards", "limits", "trials", "exposure"):
        found, wanted = (run.figures.get(figure) for run in (again, whole))
        if found != wanted:
            problems.append(f"`{figure}` is {found}, of a run that went through {wanted}")
    guards = {**again.figures["guards"], **again.figures["limits"]}
    return TrainingFinding("finishes", again.curve[-1].psnr, "", guards, tuple(problems))


def _ends_after(steps: int, *, killed: bool) -> StopCheck:
    asked = iter(range(10**6))

    def stop() -> bool:
        ends = next(asked) >= steps
        if ends and killed:
            raise _Killed
        return ends

    return stop


def stays_empty(result: TrainingResult, settings: TrainingSettings) -> list[str]:
    """Return whether Gaussians cover what is black in all photos of the balls before nothing: floaters, unseen there.

    They cost no photo anything and would stand, black, before whatever is seen from elsewhere.
    """
    views = training_input(known_capture(ground=False)[0], settings).views
    values = Parameters.from_gaussians(result.gaussians, sh_degree=settings.sh_degree, features=False).values
    covers = []
    for view in views:
        with torch.no_grad():
            raster = render(values, view.pinhole, settings, sh_degree=settings.sh_degree)
        covers.append(float((1.0 - raster.transmittance.numpy())[view.pixels.max(axis=2) == 0].mean()))
    most = float(np.mean(covers))
    return [f"{most:.1%} of what is black in the photos is covered"] if most > _MOST_COVERED else []


def continues_without_memory() -> TrainingFinding:
    """Return how a process ends that may not grow any more in the middle of training, and whether its run goes on."""
    root = Path(__file__).resolve().parents[2]
    with tempfile.TemporaryDirectory() as folder:
        child = subprocess.run(
            [sys.executable, "-m", "engine.stability.starved", folder],
            cwd=root, env={**os.environ, **ENVIRONMENT}, capture_output=True, text=True, encoding="utf-8", check=False,
        )  # fmt: skip
    try:
        answer = json.loads(child.stdout)
    except ValueError:
        last = (child.stderr.strip().splitlines() or ["nothing was said"])[-1]
        return TrainingFinding("refused", problems=(f"the process broke off, exit code {child.returncode}: {last}",))
    problems = list(answer["problems"])
    if answer["type"] is None:
        problems.append("memory was not short")
    elif answer["code"] == 0:
        problems.append("the exit code is 0")
    if answer["step"] == 0:
        problems.append("no checkpoint was left")
    if not answer["same"]:
        problems.append("continued with memory again, the Gaussians are others than those of a run that went through")
    return TrainingFinding("refused", said=f"{answer['type']}: {answer['sentence']}", problems=tuple(problems))
