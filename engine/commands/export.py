"""``export``: write the scene or an object as PLY or glTF."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import ProjectError, SettingsError
from ..events import Emit, Finished, StopCheck
from ..project_folder import ProjectFolder

if TYPE_CHECKING:
    from ..scene import ExportFrame

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "export"
HELP = "Write the scene or one object as 3DGS PLY or as glTF with KHR_gaussian_splatting."
EXAMPLE = "python -m engine export scene --object vase --format glb --out vase.glb"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    parser.add_argument("--object", help="name or id of an object (default: the whole scene)")
    parser.add_argument("--format", choices=("ply", "glb"), required=True)
    parser.add_argument("--out", type=Path, required=True, help="file to write")
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")
    parser.add_argument(
        "--without-background",
        action="store_true",
        help="leave out the sphere that shows the sky or another plain backdrop of the scene",
    )
    parser.add_argument(
        "--frame",
        choices=("upright", "original"),
        help="upright: Z up (glTF: Y up), as `measure` placed and scaled it, otherwise about unit size; original: the "
        "frame of the given or estimated poses (default: original where poses were given and nothing was measured)",
    )


def project_folder(options: argparse.Namespace) -> Path:
    """Return the project whose log is written."""
    path: Path = options.project
    return path


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Write the file."""
    from ..formats import transform_gaussians, write_glb, write_ply
    from ..gaussians import load_gaussians
    from ..objects import load_object, object_gaussians
    from ..scene import export_frame, load_measurement, read_camera_set

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
    project.require_intact("cameras", "training")
    gaussians = load_gaussians(project.path / "gaussians")
    title = "scene"
    if options.object is not None:
        record = load_object(project.path, options.object)
        gaussians = object_gaussians(project.path, record, gaussians)
        title = record.name
    left_out = 0
    if options.without_background:
        left_out = _n_background(project, len(gaussians))
        gaussians = gaussians[left_out:]
        if len(gaussians) == 0:
            raise ProjectError(f"{project.path} has nothing but background. Export it without --without-background.")
    camera_set = read_camera_set(project.path / "cameras")
    frame = export_frame(camera_set, load_measurement(project.path), options.frame)
    gaussians = transform_gaussians(gaussians, frame.from_world)
    if options.format == "ply":
        comments = [f"title {title}", *frame.as_comments(), "generator Gaussian Heritage"]
        if options.without_background:
            comments.append(f"background left out: {left_out} Gaussians")
        write_ply(out, gaussians, comments=comments)
    else:
        extras = {**frame.as_dict(), **({"background_left_out": left_out} if options.without_background else {})}
        write_glb(out, gaussians, name=title, extras=extras)
    figures = {"file": str(out), "n_gaussians": len(gaussians), "n_background_left_out": left_out, **frame.as_dict()}
    emit(Finished(f"Wrote {len(gaussians)} Gaussians to {out}; {_unit_sentence(frame)}.", figures))
    return 0


def _unit_sentence(frame: ExportFrame) -> str:
    """Return what is said of the unit of the file, as the end of a sentence."""
    if frame.metres_per_unit is None:
        return "its unit is unknown, see `measure`"
    return "its unit is the metre" if frame.is_metric else f"its unit is {frame.unit}"


def _n_background(project: ProjectFolder, n: int) -> int:
    """Return how many of the `n` Gaussians, the first ones, are the background; 0 for what release 0.1.0 trained."""
    figures = (project.stage_record("training") or {}).get("figures") or {}
    count = figures.get("n_background", 0)
    if type(count) is not int or not 0 <= count <= n:
        raise ProjectError(f"project.json in {project.path} says that {count!r} of {n} Gaussians are background.")
    return count
