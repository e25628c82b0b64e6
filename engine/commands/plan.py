"""``plan``: what a reconstruction would do, leave out and take, before any work."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from ..cameras.settings import CameraSettings
from ..events import Emit, Finished, StopCheck
from ..photos.settings import PhotoSettings
from ..planning import PlanSettings, as_dict, plan_in_words, plan_photos, require_fit
from ..training.settings import PRESETS

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "plan"
HELP = "Say what a reconstruction would do and leave out, how long it takes and how much memory, before any work."
EXAMPLE = "python -m engine plan photos --preset best"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("photos", type=Path, help="folder with the photos")
    parser.add_argument(
        "--preset", choices=sorted(PRESETS), default=PlanSettings().preset, help="how much work (default: %(default)s)"
    )
    parser.add_argument("--no-objects", action="store_true", help="only the scene: no masks, no segmentation features")
    parser.add_argument("--cameras", type=Path, help="COLMAP model folder or transforms.json to use")
    parser.add_argument(
        "--photo-masks",
        type=Path,
        metavar="FOLDER",
        help="masks named like photo.jpg.png: what is black in them is ignored in photo.jpg",
    )
    parser.add_argument("--json", action="store_true", help="the plan as JSON instead of words")


def project_folder(options: argparse.Namespace) -> None:
    """No project, no log."""


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Plan, tell, and refuse what cannot fit."""
    work, forecast, calibration = plan_photos(
        options.photos,
        PlanSettings(preset=options.preset, wants_objects=not options.no_objects),
        photos=PhotoSettings(),
        cameras=CameraSettings(),
        model=options.cameras,
        photo_masks=options.photo_masks,
        emit=emit,
        should_stop=should_stop,
    )
    require_fit(forecast, work, calibration)
    outputs = {"plan": asdict(work), "forecast": as_dict(forecast)}
    emit(Finished(json.dumps(outputs, indent=1) if options.json else plan_in_words(work, forecast), outputs))
    return 0
