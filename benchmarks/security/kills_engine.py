"""The engine with short stages, started as ``python -m benchmarks.security.kills_engine`` in place of ``engine``.

Only settings differ, so that a stage takes seconds: fewer steps, fewer clicks and photos to segment, and objects that
fit less well are kept.
"""

from __future__ import annotations

import runpy
from dataclasses import replace
from functools import partial
from typing import Any

from engine.core.system import signals_held_back

# As in `engine.__main__`: threads that libraries start must not take signals.
with signals_held_back():
    from engine.cli.commands import reconstruct as command
    from engine.masks.settings import MaskSettings
    from engine.objects.settings import DEFAULT_PRESET
    from engine.objects.settings import PRESETS as SEGMENT_PRESETS
    from engine.pipeline.planning import PlanSettings
    from engine.pipeline.reconstruct import PipelineSettings
    from engine.training.settings import PRESETS

PRESET = "test"
_COMMAND: Any = command


def shorten_stages() -> None:
    """Change the settings that ``reconstruct`` uses in this process."""
    # Enough steps, figures and checkpoints for a kill to fall between them.
    PRESETS[PRESET] = PRESETS[PRESET].changed(steps=500, curve_points=20, checkpoint_interval=40)
    # Objects of so short a training fit their masks badly.
    segment = replace(SEGMENT_PRESETS[DEFAULT_PRESET], least_score=0.0)
    SEGMENT_PRESETS[DEFAULT_PRESET] = segment
    _COMMAND.PlanSettings = partial(PlanSettings, n_mask_photos=3)
    _COMMAND.PipelineSettings = partial(PipelineSettings, segment=segment)
    _COMMAND.MASK_PRESETS["default"] = MaskSettings(max_prompts=24, grid=0)


def pipeline_settings(*, wants_objects: bool, prompts: tuple[str, ...]) -> PipelineSettings:
    """Return what ``reconstruct`` passes to the pipeline after `shorten_stages`."""
    plan = _COMMAND.PlanSettings(preset=PRESET, wants_objects=wants_objects)
    settings: PipelineSettings = _COMMAND.PipelineSettings(
        plan=plan, masks=_COMMAND.MASK_PRESETS["default"], prompts=prompts
    )
    return settings


if __name__ == "__main__":
    shorten_stages()
    # Exactly what `python -m engine` runs, its end included.
    runpy.run_module("engine", run_name="__main__")
