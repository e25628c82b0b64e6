"""``reconstruct``: photos to a project with cameras, masks, Gaussians, objects and a report."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ...cameras.settings import CameraSettings
from ...core.errors import SettingsError
from ...core.events import Emit, Finished, StopCheck
from ...masks.settings import PRESETS as MASK_PRESETS
from ...pipeline.planning import planned_device
from ...pipeline.reconstruct import PipelineSettings, reconstruct
from ...pipeline.stages import STAGES
from ...project.folder import ProjectFolder
from ...rasterizer import device_words
from .chosen_models import add_sam_argument
from .scene_options import add_plan_options, add_prompts_option, plan_settings_of, prompts_of

NAME = "reconstruct"
HELP = "Rebuild a scene from a folder of photos; continues where an earlier run stopped."
EXAMPLE = 'python -m engine reconstruct photos --out scene --prompts "vase, teapot"'
LOG_IN = "out"
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("photos", type=Path, help="folder with the photos, or a video")
    parser.add_argument("--out", type=Path, required=True, help="project folder; an unfinished run in it is continued")
    add_prompts_option(parser, "objects to isolate at the end")
    add_plan_options(parser)
    parser.add_argument(
        "--mask-background",
        action="store_true",
        help="leave the background out: Segment Anything finds the object in each photo; for an object on a turntable "
        "before a background that stands still",
    )
    parser.add_argument(
        "--transients",
        action="store_true",
        help="find transients, such as people who walk through some of the photos, and leave them out of the scene",
    )
    add_sam_argument(parser)
    parser.add_argument(
        "--until", choices=STAGES, default=STAGES[-1], help="stop after this stage; run again for the others"
    )
    parser.add_argument(
        "--segments",
        choices=MASK_PRESETS,
        default="default",
        help="settings with which Segment Anything divides a photo into segments; published: its own grid of 1,024 "
        "clicks, paper: that with the changes of Gaussian Heritage's code; both take a minute or more per photo, while "
        "the plan forecasts the time of the default (default: %(default)s)",
    )


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Run the pipeline."""
    prompts = prompts_of(options)
    if options.mask_background and options.photo_masks is not None:
        raise SettingsError("--mask-background makes the masks that --photo-masks gives. Give only one of them.")
    settings = PipelineSettings(
        plan=replace(plan_settings_of(options), exclude_transients=options.transients),
        cameras=CameraSettings(model=options.lens),
        masks=replace(MASK_PRESETS[options.segments], model=options.sam),
        given_cameras=options.cameras,
        photo_masks=options.photo_masks,
        mask_background=options.mask_background,
        prompts=prompts,
        is_followed=options.events,
    )
    project = reconstruct(
        options.photos, options.out, settings, emit=emit, should_stop=should_stop, until=options.until
    )
    if options.until != STAGES[-1]:
        message = f"The stages up to {options.until!r} are done in {project.path}. Run again without --until for all."
        emit(Finished(message, {"project": str(project.path)}))
        return 0
    figures = (project.stage_record("objects") or {}).get("figures", {}) if prompts else {}
    refused = figures.get("refused", {})
    report = project.path / "report" / "report.html"
    message = f"The scene is in {project.path}, its report in {report}.{_trained_on(project)}"
    if same := figures.get("same", {}):
        message += f" Found again, so not stored twice: {', '.join(dict.fromkeys(sum(same.values(), [])))}."
    if refused:
        message += f" Not isolated: {', '.join(refused)}. {' '.join(refused.values())}"
    outputs = {"project": str(project.path), "report": str(report), "objects": figures.get("found", {})}
    emit(Finished(message, {**outputs, "refused": refused}))
    return 0


def _trained_on(project: ProjectFolder) -> str:
    """Return a sentence about the device of the training; empty where it is not recorded."""
    record = project.stage_record("training") or {"figures": {}}
    name = record["figures"].get("device")
    if not isinstance(name, str):
        return ""
    planned = planned_device(project, str(record["figures"].get("preset")))
    return f" It was trained on {device_words(name, planned.reason if planned.name == name else '')}."
