"""``export``: write the scene or an object as PLY or glTF."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import ProjectError, SettingsError
from ..events import Emit, Finished, StopCheck
from ..project_folder import ProjectFolder

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
    from ..formats import transform_gaussians, write_glb, write_ply
    from ..gaussians import load_gaussians
    from ..objects import load_object, object_gaussians
    from ..scene import read_camera_set

    out: Path = options.out
    if out.is_dir():
        raise ProjectError(f"{out} is a folder. Choose a file name.")
    if out.suffix.lower() != f".{options.format}":
        raise SettingsError(
            f"--format {options.format} writes {options.format.upper()}, but {out} has another extension."
        )
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
    camera_set = read_camera_set(project.path / "cameras")
    frame = options.frame or ("original" if camera_set.poses_given else "upright")
    if frame == "original":
        gaussians = transform_gaussians(gaussians, camera_set.original_from_world)
    if options.format == "ply":
        write_ply(out, gaussians, comments=(f"title {title}", f"frame {frame}", "generator Gaussian Heritage"))
    else:
        write_glb(out, gaussians, name=title, extras={"frame": frame})
    emit(Finished(f"Wrote {len(gaussians)} Gaussians to {out}.", {"file": str(out), "n_gaussians": len(gaussians)}))
    return 0
