"""``frames``: the best frames of a video as photos."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ...core.errors import PhotoError
from ...core.events import Emit, Finished, StageStarted, StopCheck
from ...photos.settings import VideoSettings

NAME = "frames"
HELP = "Write the sharpest frames of a video as photos, evenly by the motion of the camera."
EXAMPLE = "python -m engine frames walk.mp4 --out photos --max 100"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("video", type=Path, help="the video")
    parser.add_argument("--out", type=Path, required=True, help="folder of the photos; photos that are there stay")
    parser.add_argument(
        "--max", type=int, default=VideoSettings.max_frames, help="most photos to write (default: %(default)s)"
    )
    parser.add_argument(
        "--density",
        type=float,
        default=VideoSettings.density,
        metavar="TIMES",
        help="this many times as many photos as by --max and the motion, 0.25 to 8; neighbouring ones then share more "
        "(default: %(default)s)",
    )


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Write the frames."""
    from ...photos import extract_frames

    if not options.video.is_file():
        raise PhotoError(f"There is no file {options.video}.")
    settings = replace(VideoSettings(), max_frames=options.max, density=options.density)
    emit(StageStarted(NAME))
    files = extract_frames(
        options.video, options.out, settings, emit=emit, should_stop=should_stop, prefix=options.video.stem
    )
    emit(Finished(f"Wrote {len(files)} photos to {options.out}.", {"photos": [file.name for file in files]}))
    return 0
