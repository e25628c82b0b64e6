"""``show-clicks``: says what clicks on photos mean while the user clicks; Blender runs it, line by line."""

from __future__ import annotations

import argparse
import functools
import sys
from dataclasses import asdict
from pathlib import Path

from ...core.errors import HeritageError
from ...core.events import Emit, Finished, StopCheck
from ...project.folder import ProjectFolder
from ...workers.jobs import Click, pack_mask, read_question
from .chosen_models import add_sam_argument

NAME = "show-clicks"
HELP = "Say what clicks on photos mean, as masks: questions are lines of JSON on standard input, for programs."
EXAMPLE = "python -m engine show-clicks scene --events"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    add_sam_argument(parser)


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Answer questions until standard input ends."""
    from ...masks import load_sam
    from ...objects import Point, click_masks, load_context
    from ...objects.grounding import load_default_detector
    from ...objects.settings import BETTER
    from ...project.objects import load_membership, load_object

    project = ProjectFolder.open_existing(options.project)
    sam = functools.partial(load_sam, options.sam)
    context = load_context(project, BETTER, load_default_detector, sam, should_stop=should_stop)

    def point(click: Click) -> Point:
        return Point(click.photo, click.x, click.y)

    for line in sys.stdin:
        if should_stop():
            break
        try:
            photo, clicks, object_id = read_question(line)
            members = None
            if object_id:
                record = load_object(project.path, object_id)
                members = load_membership(project.path, record.id) >= record.threshold
            wanted, others = ([point(one) for one in clicks if one.wanted is kind] for kind in (True, False))
            masks = asdict(click_masks(context, photo, wanted, others, members))
            emit(Finished("", {"photo": photo, "masks": {name: pack_mask(mask) for name, mask in masks.items()}}))
        except HeritageError as error:
            # The next click may be better.
            emit(Finished("", {"problem": str(error)}))
    return 0
