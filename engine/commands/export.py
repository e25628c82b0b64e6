"""``export``: write the scene or an object as PLY or glTF, or as a page that shows it."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..errors import ProjectError, SettingsError
from ..events import Emit, Finished, StopCheck
from ..project_folder import ProjectFolder

__all__ = ["EXAMPLE", "HELP", "NAME", "USES_CAMERAS", "add_arguments", "project_folder", "run"]

NAME = "export"
HELP = "Write the scene or one object as 3DGS PLY, as glTF with KHR_gaussian_splatting, or as a page that shows it."
EXAMPLE = "python -m engine export scene --object vase --format glb --out vase.glb"
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    parser.add_argument("--object", help="name or id of an object (default: the whole scene)")
    parser.add_argument(
        "--format",
        choices=("ply", "glb", "html"),
        required=True,
        help="html: one file with a viewer and the record, which a browser opens without the web",
    )
    parser.add_argument("--out", type=Path, required=True, help="file to write")
    parser.add_argument("--title", help="title of the scene in the record (default: the name of the photo folder)")
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")
    parser.add_argument(
        "--without-background",
        action="store_true",
        help="leave out the sphere that shows the sky or another plain backdrop of the scene",
    )
    parser.add_argument(
        "--record",
        choices=("full", "none"),
        default="full",
        help="what the file says of the object and how it was made; none: nothing but the Gaussians "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--frame",
        choices=("upright", "original"),
        help="upright: Z up (glTF: Y up), about unit size; original: the frame of the given or estimated poses "
        "(default: original where poses were given)",
    )


def project_folder(options: argparse.Namespace) -> Path:
    """Return the project whose log is written."""
    path: Path = options.project
    return path


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Write the file."""
    from ..packages import load_export, write_export

    out: Path = options.out
    if out.is_dir():
        raise ProjectError(f"{out} is a folder. Choose a file name.")
    if out.suffix.lower() != f".{options.format}":
        raise SettingsError(
            f"--format {options.format} writes {options.format.upper()}, but {out} has another extension."
        )
    if options.object is not None and options.without_background:
        raise SettingsError("--without-background is for whole scenes; an object has no background. Leave it out.")
    if out.exists() and not options.overwrite:
        raise ProjectError(f"{out} already exists. Choose another name or add --overwrite.")
    project = ProjectFolder.open_existing(options.project)
    export = load_export(project, options.object, title=options.title)
    left_out = 0
    if options.without_background:
        left_out = _n_background(project, len(export.gaussians))
        notes = {"background_left_out": left_out}
        export = replace(export, gaussians=export.gaussians[left_out:], notes=notes)
        if len(export.gaussians) == 0:
            raise ProjectError(f"{project.path} has nothing but background. Export it without --without-background.")
    shown = options.format == "html"
    frame = options.frame or ("original" if export.camera_set.poses_given and not shown else "upright")
    write_export(out, export, options.format, frame=frame, with_record=options.record == "full")
    figures = {"file": str(out), "n_gaussians": len(export.gaussians), "n_background_left_out": left_out}
    emit(Finished(f"Wrote {len(export.gaussians)} Gaussians to {out}.", figures))
    return 0


def _n_background(project: ProjectFolder, n: int) -> int:
    """Return how many of the `n` Gaussians, the first ones, are the background; 0 for what release 0.1.0 trained."""
    figures = (project.stage_record("training") or {}).get("figures") or {}
    count = figures.get("n_background", 0)
    if type(count) is not int or not 0 <= count <= n:
        raise ProjectError(f"project.json in {project.path} says that {count!r} of {n} Gaussians are background.")
    return count
