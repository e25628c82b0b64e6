"""``plan``: what a reconstruction would do and omit, and how much time and memory it needs; nothing is written."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from ...cameras.settings import CameraSettings
from ...core.events import Emit, Finished, StopCheck
from ...photos.settings import PhotoSettings
from ...pipeline.planning import (
    forecast_as_dict,
    format_plan,
    format_presets,
    plan_presets,
    require_enough_memory,
    work_plan_as_dict,
)
from ...training.settings import OFFERED_PRESETS
from .scene_options import add_plan_options, plan_settings_of

NAME = "plan"
HELP = "Show what a reconstruction would do and omit, and how much time and memory it needs, before any work."
EXAMPLE = "python -m engine plan photos --preset best"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("photos", type=Path, help="folder with the photos")
    add_plan_options(parser)
    parser.add_argument(
        "--every-preset", action="store_true", help="only how long each preset would take, with the time of each stage"
    )
    parser.add_argument("--json", action="store_true", help="print the plan as JSON instead of text")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Print the plan, and refuse work for which there is too little memory."""
    plans = plan_presets(
        options.photos,
        plan_settings_of(options),
        [preset.name for preset in OFFERED_PRESETS] if options.every_preset else [options.preset],
        photos=PhotoSettings(),
        cameras=CameraSettings(model=options.lens),
        given_cameras=options.cameras,
        photo_masks=options.photo_masks,
        emit=emit,
        should_stop=should_stop,
    )
    if options.every_preset:
        forecasts = [(preset, planned.forecast) for preset, planned in zip(OFFERED_PRESETS, plans, strict=True)]
        answer = {"presets": [{"name": one.name, "forecast": forecast_as_dict(known)} for one, known in forecasts]}
        emit(Finished(json.dumps(answer, indent=1) if options.json else format_presets(forecasts), answer))
        return 0
    work, forecast, calibration = plans[0]
    require_enough_memory(forecast, work, calibration)
    outputs = {"plan": work_plan_as_dict(work), "forecast": forecast_as_dict(forecast)}
    emit(Finished(json.dumps(outputs, indent=1) if options.json else format_plan(work, forecast), outputs))
    return 0
