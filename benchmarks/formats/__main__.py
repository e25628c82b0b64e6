"""Measures file formats into docs/formats.md and docs/meshes.md, for `make bench-formats` and `make readers-test`.

example: python -m benchmarks.formats readers --project out/museum_room/project --doc docs/formats.md
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.documents import print_table
from engine.core.errors import HeritageError
from engine.core.system import describe_machine
from engine.formats import read_ply

from ..places import ROOT
from .readers import reader_rows, require_node_modules
from .speed import COUNT, N_MEMORY, N_ROUNDS, memory_rows, speed_rows

if TYPE_CHECKING:
    from .viewers import Framed

LEAST_PSNR = 28.0
LEAST_OVERLAP = 0.9
"""Share of the pixels of either outline of a mesh that are in both."""
FOUND_GOOD = ("0 errors", "watertight")
"""Begins of what programs find in meshes that they take."""
LEAST_EXTENT = 0.25
"""Share of the picture's width or height that a viewer's own framing fills. With its far Gaussians, a room is a dot."""


def main() -> int:
    """Measure, and write and print a part of the document; return 1 when a reader or a viewer shows something else."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, text in (
        ("speed", "time, size and memory"),
        ("readers", "other programs' readers, and viewers"),
        ("meshes", "meshes in viewers, Blender and programs for printing"),
    ):
        command = commands.add_parser(name, help=text)
        command.add_argument("--doc", type=Path, required=True)
        if name != "speed":
            command.add_argument("--project", type=Path, required=True, help="a project folder with a scene")
            command.add_argument("--object", default="vase", help="an object of it (default: %(default)s)")
            command.add_argument("--pictures", type=Path, help="folder for screenshots")
    options = parser.parse_args()
    try:
        require_node_modules()
        with tempfile.TemporaryDirectory() as name:
            return {"speed": speed, "readers": readers, "meshes": meshes}[options.command](options, Path(name))
    except HeritageError as error:
        print(error, file=sys.stderr)
        return 1


def speed(options: argparse.Namespace, folder: Path) -> int:
    """Measure speed, size and memory."""
    rows = [*speed_rows(folder), *memory_rows(folder)]
    text = (
        f"{COUNT:,} random Gaussians with harmonics of degree 3; memory with {N_MEMORY:,}. Least of {N_ROUNDS} rounds "
        "in turn: seconds of the processor, and by the clock in brackets. All programs begin or end with the same "
        "arrays. "
        f"Machine: {describe_machine().name}, shared with other work.\n\n" + _table(("what", "measured", "goal"), rows)
    )
    print_table(text, options.doc, "speed")
    return 0


def readers(options: argparse.Namespace, folder: Path) -> int:
    """Compare with other programs, and look at files in viewers."""
    from .viewers import framed_by_viewers, shown_in_viewers

    scene = read_ply(options.project / "gaussians" / "scene.ply")
    rows = reader_rows(scene, folder)
    files = [_exported(options.project, folder / f"scene.{kind}") for kind in ("ply", "glb")]
    shown = shown_in_viewers(options.project, files, options.pictures)
    files = [_exported(options.project, folder / f"object.{kind}", options.object) for kind in ("ply", "glb")]
    framed = framed_by_viewers(files, options.pictures)
    pictures = [
        (
            one.viewer,
            one.file,
            ", ".join(f"{value:.1f}" for value in one.psnr),
            f"{one.psnr_upside_down:.1f}",
            *_shares(one.framed),
        )
        for one in shown
    ]
    head = (
        "viewer", "file", "PSNR beside our pictures, dB", "beside them upside down", "covered when opened",
        "largest side when opened",
    )  # fmt: skip
    text = (
        f"{len(scene):,} Gaussians of the museum room. Differences are the largest of positions, log-scales, "
        "opacities, covariances relative to the largest size, and coefficients.\n\n"
        + _table(("file", "read by", "largest difference"), rows)
        + "\n\n"
        + _table(head, pictures)
        + f"\n\nThe object `{options.object}` as viewers open it:\n\n"
        + _table(("viewer", "file", *head[-2:]), [(viewer, kind, *_shares(one)) for viewer, kind, one in framed])
    )
    print_table(text, options.doc, "readers")
    bad = [one for one in shown if min(one.psnr) < LEAST_PSNR]
    for one in bad:
        print(f"{one.viewer} shows {one.file} otherwise than the engine: {min(one.psnr):.1f} dB.", file=sys.stderr)
    framings = [(one.viewer, one.file, one.framed) for one in shown] + framed
    small = [one for one in framings if one[2].extent < LEAST_EXTENT]
    for viewer, kind, found in small:
        print(f"{viewer} opens {kind} too small: {100 * found.extent:.0f} % of the picture.", file=sys.stderr)
    return 1 if bad or small or any("other" in row[2] or " of " in row[2] for row in rows) else 0


def meshes(options: argparse.Namespace, folder: Path) -> int:
    """Look at the meshes of an object in viewers and Blender, and let other programs check them."""
    from .mesh_programs import check_rows, drawn_rows, exported_meshes, shown_in_model_viewer

    files = exported_meshes(options.project, options.object, folder)
    (shown, pictures), checked = drawn_rows(files), check_rows(files)
    same, framed, shot = shown_in_model_viewer(files)
    if options.pictures is not None:
        from .viewers import keep_pictures

        options.pictures.mkdir(parents=True, exist_ok=True)
        keep_pictures(options.pictures / "mesh_programs.jpg", [*pictures, shot])
    text = (
        f"The object `{options.object}` of {options.project.parent.name}.\n\n"
        + _table(("drawn without light by", "file", "PSNR beside our picture, dB", "same outline, %"), shown)
        + f"\n\nmodel-viewer draws the GLB with light of its own: same outline {100 * same:.1f} %. As it opens the "
        f"file, the object's largest side fills {100 * framed.extent:.0f} % of the picture.\n\n"
        + _table(("file", "checked by", "found"), checked)
    )
    print_table(text, options.doc, "programs")
    bad = [f"{row[0]} shows {row[1]}" for row in shown if float(row[2].split(",")[0]) < LEAST_PSNR]
    bad += ["model-viewer shows GLB"] if same < LEAST_OVERLAP or framed.extent < LEAST_EXTENT else []
    for one in bad:
        print(f"{one} otherwise than we do.", file=sys.stderr)
    wrong = [row for row in checked if not row[2].startswith(FOUND_GOOD) or {"no", "not"} & set(row[2].split())]
    for file, program, found in wrong:
        print(f"{program} finds in {file}: {found}", file=sys.stderr)
    return int(bool(bad or wrong))


def _exported(project: Path, file: Path, name: str | None = None) -> Path:
    """Export the scene, or the object of that name, in the format of the suffix of `file`."""
    words = ["export", str(project), "--format", file.suffix[1:], "--frame", "upright", "--out", str(file)]
    words += [] if name is None else ["--object", name]
    subprocess.run([sys.executable, "-m", "engine", *words], cwd=ROOT, check=True, capture_output=True)
    return file


def _shares(framed: Framed) -> tuple[str, str]:
    return f"{100 * framed.covered:.0f} %", f"{100 * framed.extent:.0f} %"


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    sys.exit(main())
