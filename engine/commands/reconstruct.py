"""``reconstruct``: photos to a project with cameras, masks, Gaussians, objects and a report."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..errors import SettingsError
from ..events import Emit, Finished, StopCheck
from ..masks.settings import PRESETS as MASK_PRESETS
from ..pipeline import PipelineSettings, reconstruct
from ..planning import PlanSettings
from ..training.settings import PRESETS
from .chosen_models import add_sam_argument

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "reconstruct"
HELP = "Rebuild a scene from a folder of photos; continues where an earlier run stopped."
EXAMPLE = 'python -m engine reconstruct photos --out scene --prompts "vase;teapot"'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    defaults = PlanSettings()
    parser.add_argument("photos", type=Path, help="folder with the photos")
    parser.add_argument("--out", type=Path, required=True, help="project folder, new or to be continued")
    parser.add_argument("--prompts", default="", help='objects to isolate at the end, e.g. "vase;bust"')
    parser.add_argument(
        "--preset", choices=sorted(PRESETS), default=defaults.preset, help="how much work (default: %(default)s)"
    )
    parser.add_argument(
        "--cameras", type=Path, help="COLMAP model folder or transforms.json to use instead of estimating"
    )
    parser.add_argument(
        "--photo-masks",
        type=Path,
        metavar="FOLDER",
        help="masks named like photo.jpg.png: what is black in them is ignored in photo.jpg",
    )
    parser.add_argument(
        "--passers-by", action="store_true", help="people walk through some of the photos: leave them out of the scene"
    )
    parser.add_argument("--no-objects", action="store_true", help="only the scene: no masks, no segmentation features")
    add_sam_argument(parser)
    parser.add_argument(
        "--segments",
        choices=MASK_PRESETS,
        default="default",
        help="how it cuts a photo into segments; published: its own grid of 1,024 clicks, paper: that with the changes "
        "of Gaussian Heritage's code, both a minute and more a photo; the plan's minutes are those of the default "
        "(default: %(default)s)",
    )


def project_folder(options: argparse.Namespace) -> Path:
    """Return where the log goes."""
    out: Path = options.out
    return out


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Run the pipeline."""
    prompts = tuple(dict.fromkeys(prompt.strip() for prompt in options.prompts.split(";") if prompt.strip()))
    if options.prompts and not prompts:
        raise SettingsError(f'--prompts {options.prompts!r} names nothing. Write for example: --prompts "vase;bust".')
    if options.no_objects and prompts:
        raise SettingsError("--no-objects leaves out what --prompts needs. Give only one of them.")
    settings = PipelineSettings(
        plan=PlanSettings(preset=options.preset, wants_objects=not options.no_objects, passers_by=options.passers_by),
        masks=replace(MASK_PRESETS[options.segments], model=options.sam),
        camera_model=options.cameras,
        photo_masks=options.photo_masks,
        prompts=prompts,
    )
    project = reconstruct(options.photos, options.out, settings, emit=emit, should_stop=should_stop)
    figures = (project.stage_record("objects") or {}).get("figures", {}) if prompts else {}
    refused = figures.get("refused", {})
    report = project.path / "report" / "report.html"
    message = f"The scene lies in {project.path}, its report in {report}."
    if refused:
        message += f" Not isolated: {', '.join(refused)}. {' '.join(refused.values())}"
    outputs = {"project": str(project.path), "report": str(report), "objects": figures.get("found", {})}
    emit(Finished(message, {**outputs, "refused": refused}))
    return 0
