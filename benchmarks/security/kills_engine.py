"""The engine with short stages, started as ``python -m benchmarks.security.kills_engine`` in place of ``engine``.

Only settings differ, so that a stage takes seconds: fewer steps, fewer clicks and photos to segment, and objects that
fit less well are kept.
"""

from __future__ import annotations

import os
import runpy
from dataclasses import replace
from functools import partial
from typing import Any

from engine.cameras.settings import CameraSettings
from engine.commands import reconstruct as command
from engine.masks.settings import MaskSettings
from engine.objects.settings import DEFAULT_PRESET
from engine.objects.settings import PRESETS as SEGMENT_PRESETS
from engine.pipeline import PipelineSettings
from engine.planning import PlanSettings
from engine.training.settings import PRESETS

__all__ = ["PRESET", "SEED", "THREADS", "pipeline_settings", "shorten_stages"]

PRESET = "test"
SEED, THREADS = "GAUSSIAN_HERITAGE_KILLS_SEED", "GAUSSIAN_HERITAGE_KILLS_THREADS"
"""Environment variables: random seed of cameras and training; threads of COLMAP, 0 for all cores."""

_COMMAND: Any = command


def shorten_stages(seed: int, threads: int) -> None:
    """Change the settings that ``reconstruct`` uses in this process.

    Parameters
    ----------
    seed : int
        Of the cameras and of training.
    threads : int
        Threads of COLMAP. With 1, poses repeat exactly; 0 takes all cores.
    """
    # Enough steps, figures and checkpoints for a kill to fall between them.
    PRESETS[PRESET] = PRESETS[PRESET].changed(steps=500, curve_points=20, checkpoint_interval=40, seed=seed)
    # Objects of so short a training fit their masks badly.
    segment = replace(SEGMENT_PRESETS[DEFAULT_PRESET], least_score=0.2)
    SEGMENT_PRESETS[DEFAULT_PRESET] = segment
    _COMMAND.PlanSettings = partial(PlanSettings, n_mask_photos=3)
    _COMMAND.PipelineSettings = partial(
        PipelineSettings, cameras=CameraSettings(threads=threads, seed=seed), segment=segment
    )
    _COMMAND.MASK_PRESETS["default"] = MaskSettings(max_prompts=8, grid=0)


def pipeline_settings(*, wants_objects: bool, prompts: tuple[str, ...]) -> PipelineSettings:
    """Return what ``reconstruct`` passes to the pipeline after `shorten_stages`."""
    plan = _COMMAND.PlanSettings(preset=PRESET, wants_objects=wants_objects)
    settings: PipelineSettings = _COMMAND.PipelineSettings(
        plan=plan, masks=_COMMAND.MASK_PRESETS["default"], prompts=prompts
    )
    return settings


if __name__ == "__main__":
    shorten_stages(int(os.environ[SEED]), int(os.environ[THREADS]))
    # Exactly what `python -m engine` runs, its end included.
    runpy.run_module("engine", run_name="__main__")
