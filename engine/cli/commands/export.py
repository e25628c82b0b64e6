"""``export``: write the scene or an object in one of `engine.formats.FORMATS`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arrays import Float64
from ...core.errors import ProjectError, SettingsError
from ...core.events import Emit, Finished, Progress, StopCheck, Warned
from ...formats import FORMATS, Format, format_of
from ...meshing.settings import LEVELS, MeshSettings
from ...project.folder import ProjectFolder
from ...scene import ExportFrame

if TYPE_CHECKING:
    from ...delivery.packages import Export

NAME = "export"
HELP = "Write the scene or one object as a file of Gaussians or a mesh for other programs, or as a page."
EXAMPLE = "python -m engine export scene --object vase --format glb --out vase.glb"
LOG_IN = "project"
USES_CAMERAS = True
FAR = ("leave-out", "keep", "second-file")
"""What becomes of far Gaussians of a scene."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    parser.add_argument("--object", help="name or id of an object (default: the whole scene)")
    written = [one for one in FORMATS if one.write is not None or one.write_mesh is not None or one.is_page]
    parser.add_argument(
        "--format",
        choices=[one.name for one in written],
        required=True,
        help=". ".join(f"{one.name}: {one.description}" for one in written),
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
        "--far",
        choices=FAR,
        default=FAR[0],
        help="Gaussians of a scene that lie a quarter, or reach half, farther out than cameras and sparse points, "
        "which make viewers show the scene as a dot: left out, kept, or written to a second file, NAME_far "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--origin",
        choices=("own", "scene"),
        default="own",
        help="origin of an object's file: the middle of its bottom, or that of the scene (default: %(default)s; "
        "the scene's with --frame original or world)",
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
        choices=("upright", "original", "world"),
        help="upright: as `measure` placed and scaled it, otherwise about unit size; original: the frame of the given "
        "or estimated poses; world: the frame of cameras/cameras.json, Z up in PLY, too (default: original where poses "
        "were given and nothing was measured, otherwise upright)",
    )
    parser.add_argument(
        "--placement",
        metavar="A,B,...",
        help="in place of --frame: 16 numbers, the rows of a matrix from the frame of cameras/cameras.json to that "
        "of the file before its format's axes, Z up",
    )
    parser.add_argument(
        "--unit",
        choices=("metre", "unknown"),
        default="unknown",
        help="unit of what --placement places (default: %(default)s)",
    )
    parser.add_argument(
        "--triangles",
        type=int,
        choices=LEVELS,
        default=MeshSettings.triangles,
        help="largest number of triangles of a mesh (default: %(default)s)",
    )
    parser.add_argument(
        "--watertight",
        action="store_true",
        help="close a mesh where no photo saw the object, such as its underside; the file marks what was filled in",
    )


def _matrix(text: str) -> Float64:
    """Return the affine matrix [4, 4] that 16 numbers give, row by row."""
    try:
        matrix = np.array([float(word) for word in text.split(",")]).reshape(4, 4)
    except ValueError as error:
        raise SettingsError(f"--placement {text} is not 16 numbers. Give them with commas between them.") from error
    if not np.isfinite(matrix).all() or (matrix[3] != (0, 0, 0, 1)).any() or np.linalg.det(matrix) == 0:
        raise SettingsError(f"--placement {text} places nothing. Give an invertible matrix with the last row 0,0,0,1.")
    return matrix


def _frame(options: argparse.Namespace) -> ExportFrame | str | None:
    """Return the frame that was asked for."""
    frame: str | None = options.frame
    if options.placement is None:
        if options.unit != "unknown":
            raise SettingsError("--unit says what --placement places. Leave it out, or give --placement.")
        return frame
    if frame is not None:
        raise SettingsError("--frame and --placement both say where the file is. Give only one.")
    return ExportFrame("placed", _matrix(options.placement), 1.0 if options.unit == "metre" else None)


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Write the file."""
    from ...delivery.packages import divided, load_export, write_export

    kind = format_of(options.format)
    out: Path = options.out
    if out.is_dir():
        raise ProjectError(f"{out} is a folder. Choose a file name.")
    if out.suffix.lower() not in kind.suffixes:
        raise SettingsError(f"--format {kind.name} writes {', '.join(kind.suffixes)}, but {out} has another extension.")
    if options.object is not None and options.without_background:
        raise SettingsError("--without-background is for whole scenes; an object has no background. Leave it out.")
    if kind.is_page and options.far != FAR[0]:
        raise SettingsError("A page frames the scene by its cameras and shows all of it. Leave out --far.")
    if kind.write_mesh is None and (options.watertight or options.triangles != MeshSettings.triangles):
        raise SettingsError(
            "--triangles and --watertight are for meshes. Leave them out, or choose a format of meshes."
        )
    if not kind.carries_record and options.record == "full":
        emit(
            Warned(f"{kind.label} has no place for text, so the file has no record. Export another format to keep it.")
        )
    second = out.with_name(f"{out.stem}_far{out.suffix}")
    written = [out, *([second] if options.far == "second-file" else []), *(out.with_suffix(one) for one in kind.beside)]
    existing = [file for file in written if file.exists()]
    if existing and not options.overwrite:
        raise ProjectError(f"{existing[0]} already exists. Choose another name or add --overwrite.")
    project = ProjectFolder.open_existing(options.project)
    export = load_export(project, options.object, title=options.title)
    if kind.write_mesh is not None:
        _write_mesh(options, project, export, kind, emit, should_stop)
        return 0
    left_out = 0
    if options.without_background:
        left_out = _n_background(project, len(export.gaussians))
        notes = {"background_left_out": left_out}
        export = replace(export, gaussians=export.gaussians[left_out:], notes=notes)
        if len(export.gaussians) == 0:
            raise ProjectError(f"{project.path} has nothing but background. Export it without --without-background.")
    near, far = divided(export) if not kind.is_page and options.far != "keep" else (export, None)
    frame = _frame(options)
    shown = "upright" if kind.is_page and frame is None else frame
    how: dict[str, Any] = {
        "frame": shown,
        "with_record": options.record == "full",
        "in_scene": options.origin == "scene",
    }
    placed = write_export(out, near, options.format, **how)
    n_far = 0 if far is None else len(far.gaussians)
    if far is not None and options.far == "second-file":
        write_export(second, far, options.format, **how)
    figures = {"file": str(out), "n_gaussians": len(near.gaussians), "n_background_left_out": left_out}
    figures |= {"n_far": n_far, **placed.as_dict()}
    emit(
        Finished(
            f"Wrote {len(near.gaussians)} Gaussians to {out}; {_unit_sentence(placed)}.{_far(n_far, options, second)}",
            figures,
        )
    )
    return 0


def _write_mesh(
    options: argparse.Namespace,
    project: ProjectFolder,
    export: Export,
    kind: Format,
    emit: Emit,
    should_stop: StopCheck,
) -> None:
    """Make the mesh of an object and write it."""
    from ...delivery.packages import mesh_of, mesh_sentence, write_mesh_export

    made = mesh_of(
        project,
        export,
        MeshSettings(
            triangles=options.triangles,
            watertight=options.watertight,
            texture_side=MeshSettings.texture_side if kind.shows_texture else 0,
        ),
        should_stop=should_stop,
        tell=lambda done: emit(Progress("export", done, message="meshing")),
    )
    placed = write_mesh_export(
        options.out,
        export,
        made,
        kind.name,
        frame=_frame(options),
        with_record=options.record == "full",
        in_scene=options.origin == "scene",
    )
    if options.watertight and not made.record["watertight"]:
        emit(Warned("The surface could not be closed: parts of it touch. Export it with another number of triangles."))
    emit(
        Finished(
            f"Wrote a mesh to {options.out}; {mesh_sentence(made, placed)}; {_unit_sentence(placed)}.",
            {"file": str(options.out), "object": options.object, **made.record, **placed.as_dict()},
        )
    )


def _far(count: int, options: argparse.Namespace, second: Path) -> str:
    """Return what is said of far Gaussians."""
    if not count:
        return ""
    if options.far == "second-file":
        return f" {count} far Gaussians are in {second.name}."
    return f" {count} far Gaussians were left out; `--far keep` or `--far second-file` writes them."


def _unit_sentence(frame: ExportFrame) -> str:
    """Return what is said of the unit of the file, as the end of a sentence."""
    if frame.metres_per_unit is None:
        return "its unit is unknown, see `measure`"
    return "its unit is the metre" if frame.is_metric else f"its unit is {frame.unit}"


def _n_background(project: ProjectFolder, n: int) -> int:
    """Return how many of the `n` Gaussians, the first ones, are the background; 0 where none is recorded."""
    figures = (project.stage_record("training") or {}).get("figures") or {}
    count = figures.get("n_background", 0)
    if type(count) is not int or not 0 <= count <= n:
        raise ProjectError(f"project.json in {project.path} says that {count!r} of {n} Gaussians are background.")
    return count
