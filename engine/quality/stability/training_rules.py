"""Rules of training that hold exactly: a run that was stopped, killed or out of memory ends with the same Gaussians."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import torch

from ...core.errors import Cancelled, FormatError
from ...core.events import StopCheck
from ...core.files import parse_json
from ...core.system import CODE_ROOT
from ...training import Parameters, TrainingResult, render
from ...training.settings import TrainingSettings
from .memory_limit import MALLOC_ENVIRONMENT
from .training_measure import CheckpointMonitor, TrainingFinding, run_training, same_gaussians
from .training_scenes import SETTINGS, known_capture, training_input

_STEPS_PER_ATTEMPT = (1, 47, 20, 35)
"""Steps of each attempt: they end before the first checkpoint, between two, after growth, and near the end."""

_ANSWER = {"type": (str, None), "message": str, "code": int, "step": int, "problems": [str], "same": bool}
"""The last line that `engine.quality.stability.memory_limit` prints."""

_MAX_COVERED_SHARE = 0.05
"""Largest mean opacity of pixels that are black in the photos. The soft edges of the balls cause 1 to 2 %."""


class _Killed(BaseException):
    """Ends a run like a kill signal: no code gets to write a checkpoint."""


def resumes_exactly(*, killed: bool) -> TrainingFinding:
    """Check that a run that is stopped (or killed) four times gives the Gaussians of an uninterrupted run.

    The run trains exposure, whose moments are part of the state, and grows between the stops.
    """
    settings = SETTINGS.changed(exposure=True, max_gaussians=600)
    capture = known_capture()[0].with_gains(list(np.linspace(0.7, 1.0, 12)))
    inputs = training_input(capture, settings)
    problems: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        uninterrupted = run_training(inputs, settings, folder / "uninterrupted", lambda: False)
        for steps in _STEPS_PER_ATTEMPT:
            monitor = CheckpointMonitor(folder / "resumed", _stop_after(steps, killed=killed))
            try:
                run_training(inputs, settings, folder / "resumed", monitor)
                problems.append(f"the run did not end after {steps} steps")
            except (Cancelled, _Killed):
                problems += monitor.problems
        resumed = run_training(inputs, settings, folder / "resumed", lambda: False)
    if not same_gaussians(uninterrupted.gaussians, resumed.gaussians):
        problems.append("the Gaussians differ from those of an uninterrupted run")
    for figure in ("psnr", "guards", "limits", "trials", "exposure"):
        found, expected = (run.figures.get(figure) for run in (resumed, uninterrupted))
        if found != expected:
            problems.append(f"`{figure}` is {found}, in an uninterrupted run {expected}")
    guards = {**resumed.figures["guards"], **resumed.figures["limits"]}
    return TrainingFinding("finishes", resumed.curve[-1].psnr, "", guards, tuple(problems))


def _stop_after(steps: int, *, killed: bool) -> StopCheck:
    steps_done = iter(range(10**6))

    def stop() -> bool:
        ends = next(steps_done) >= steps
        if ends and killed:
            raise _Killed
        return ends

    return stop


def stays_empty(result: TrainingResult, settings: TrainingSettings) -> list[str]:
    """Check that no Gaussians cover the pixels that are black in the photos of the balls without a floor.

    Black Gaussians in front of the black background do not change any photo, but hide the scene from other directions.
    """
    views = training_input(known_capture(ground=False)[0], settings).views
    values = Parameters.from_gaussians(result.gaussians, sh_degree=settings.appearance.sh_degree, features=False).values
    coverage = []
    for view in views:
        with torch.no_grad():
            raster = render(values, view.pinhole, backend=settings.backend, sh_degree=settings.appearance.sh_degree)
        coverage.append(float((1.0 - raster.transmittance.numpy())[view.pixels.max(axis=2) == 0].mean()))
    share = float(np.mean(coverage))
    return [f"{share:.1%} of the black pixels in the photos is covered"] if share > _MAX_COVERED_SHARE else []


def resumes_after_memory_error() -> TrainingFinding:
    """Check that training whose memory is limited half-way ends with an error, and that the run can be resumed."""
    with tempfile.TemporaryDirectory() as folder:
        child = subprocess.run(
            [sys.executable, "-m", "engine.quality.stability.memory_limit", folder],
            cwd=CODE_ROOT, env={**os.environ, **MALLOC_ENVIRONMENT}, capture_output=True, text=True, encoding="utf-8",
            check=False,
        )  # fmt: skip
    try:
        answer = parse_json(child.stdout, _ANSWER, source="the answer of the process", advice="")
    except FormatError:
        last = (child.stderr.strip().splitlines() or ["no message"])[-1]
        return TrainingFinding("refused", problems=(f"the process failed with exit code {child.returncode}: {last}",))
    problems = list(answer["problems"])
    if answer["type"] is None:
        problems.append("training did not run out of memory")
    elif answer["code"] == 0:
        problems.append("the exit code is 0")
    if answer["step"] == 0:
        problems.append("there is no checkpoint")
    if not answer["same"]:
        problems.append("after resuming, the Gaussians differ from those of an uninterrupted run")
    return TrainingFinding("refused", message=f"{answer['type']}: {answer['message']}", problems=tuple(problems))
