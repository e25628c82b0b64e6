"""``turntable``: pictures of the scene or an object from all sides, as a contact sheet and as films."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.errors import ObjectError, ProjectError
from ...core.events import Emit, Finished, StopCheck
from ...project.folder import ProjectFolder
from .scene_options import add_device_option

NAME = "turntable"
HELP = "Write a contact sheet (PNG) and a film (WebM and MP4) of an object that turns, or of the scene's photo places."
EXAMPLE = "python -m engine turntable scene --object vase --out vase_pictures"
LOG_IN = "project"
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    parser.add_argument("--object", help="name or id of an object (default: the whole scene)")
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")
    add_device_option(parser, "render the pictures")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Render the pictures and write the files."""
    from ...delivery.packages import FILMS, SHEET, Turn, load_export, turn_of, write_films, write_sheet
    from ...rasterizer import Device, choose_device, device_words, run_on

    out: Path = options.out
    if out.exists() and not out.is_dir():
        raise ProjectError(f"{out} is a file. Choose a folder for the pictures.")
    existing = [name for name in (SHEET, *FILMS) if (out / name).exists()]
    if existing and not options.overwrite:
        raise ProjectError(f"{out / existing[0]} already exists. Choose another folder or add --overwrite.")
    export = load_export(ProjectFolder.open_existing(options.project), options.object)
    title = export.described["title"]
    if len(export.gaussians) == 0:
        raise ObjectError(f"{title} has no Gaussians, so there is nothing to show. Isolate it again.")

    def turn(device: Device) -> Turn:
        return turn_of(export, device.backend, should_stop)

    made, device = run_on(choose_device(options.device), turn)
    write_sheet(out / SHEET, title, made.pictures)
    files = [out / SHEET, *write_films(out, made)]
    words = f"They were rendered on {device_words(device.name, device.reason)}."
    emit(Finished(f"Wrote {len(made.pictures)} pictures to {out}. {words}", {"files": [str(file) for file in files]}))
    return 0
