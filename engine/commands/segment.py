"""``segment``: isolate objects of a trained scene by text, click, box or a given mask."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..events import Emit, Finished, StopCheck
from ..masks.settings import SAM_MODELS
from ..objects.prompts import parse_prompt
from ..objects.settings import DEFAULT_PRESET, PRESETS
from ..project_folder import ProjectFolder

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "segment"
HELP = "Isolate an object of a scene by text, click, box or a given mask image."
EXAMPLE = "python -m engine segment scene --click IMG_3023.jpg=364,500 --name statue"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    prompt = parser.add_mutually_exclusive_group(required=True)
    prompt.add_argument("--prompt", metavar="TEXT", help="what it is, in words")
    prompt.add_argument("--click", metavar="PHOTO=x,y", help="a pixel of a photo, from its top left corner")
    prompt.add_argument("--box", metavar="PHOTO=x0,y0,x1,y1", help="a box in a photo, in pixels")
    prompt.add_argument(
        "--seed-mask", metavar="PHOTO=MASK.png", help="a mask of the photo's size, white where the object is"
    )
    parser.add_argument("--name", help="name of the object (default: the text, or 'object')")
    parser.add_argument(
        "--preset", choices=sorted(PRESETS), default=DEFAULT_PRESET, help="method (default: %(default)s)"
    )
    parser.add_argument(
        "--sam", choices=SAM_MODELS, default=SAM_MODELS[0], help="which Segment Anything (default: %(default)s)"
    )


def project_folder(options: argparse.Namespace) -> Path:
    """Return where the log goes."""
    path: Path = options.project
    return path


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Isolate the object and store it in the project."""
    from ..grounding.default import load_default_detector
    from ..masks.sam import load_sam
    from ..objects.segment import segment_project

    with ProjectFolder.open_existing(options.project) as project:
        prompt = parse_prompt(text=options.prompt, click=options.click, box=options.box, seed_mask=options.seed_mask)
        records = segment_project(
            project,
            prompt,
            options.name or options.prompt or "object",
            PRESETS[options.preset],
            detector_factory=load_default_detector,
            sam_factory=lambda: load_sam(options.sam),
            emit=emit,
            should_stop=should_stop,
        )
    names = ", ".join(f"{record.name} ({record.score:.2f})" for record in records)
    emit(Finished(f"Isolated {names}.", {"objects": [record.id for record in records]}))
    return 0
