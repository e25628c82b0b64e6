"""``bench``: presets side by side on one scene, error against run time."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..bench.settings import BenchSettings
from ..errors import ProjectError, SettingsError
from ..events import Emit, Finished, StopCheck
from ..project_folder import PROJECT_FILE, ProjectFolder
from ..training.settings import PRESETS

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "bench"
HELP = "Train presets on one scene and compare their error against run time; what is done is kept."
EXAMPLE = "python -m engine bench photos --presets preview,standard,best --limit 30 --out comparison"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("scene", type=Path, help="folder with photos, or a project, which is only read")
    parser.add_argument(
        "--presets", default="preview,standard", help=f"which, of {', '.join(sorted(PRESETS))} (default: %(default)s)"
    )
    parser.add_argument("--out", type=Path, help="folder for the runs and tables (default: SCENE-bench beside it)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the table and its picture there")
    parser.add_argument("--cameras", type=Path, help="COLMAP model folder or transforms.json to use")
    parser.add_argument(
        "--photo-masks",
        type=Path,
        metavar="FOLDER",
        help="masks named like photo.jpg.png: what is black in them is ignored in photo.jpg",
    )
    parser.add_argument("--no-objects", action="store_true", help="no masks, no segmentation features")
    parser.add_argument("--limit", type=float, metavar="MINUTES", help="stop the training of a preset after this long")
    parser.add_argument(
        "--everything",
        action="store_true",
        help="train each preset once more with nothing left out: measures what leaving out saves and costs",
    )
    parser.add_argument(
        "--seeds", default="0", metavar="N,N", help="train each preset by each of these (default: %(default)s)"
    )


def project_folder(options: argparse.Namespace) -> None:
    """No log: every preset is a project of its own."""


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Compare, write and tell."""
    from ..bench import compare, markdown, savings, write_comparison

    scene: Path = options.scene
    is_project = (scene / PROJECT_FILE).is_file()
    if is_project and options.cameras is not None:
        raise SettingsError(f"{scene} is a project and has its cameras. Leave out --cameras, or name its photos.")
    if is_project and options.photo_masks is not None:
        raise SettingsError(f"{scene} is a project and has its masks. Leave out --photo-masks, or name its photos.")
    out: Path = options.out or scene.resolve().with_name(f"{scene.resolve().name}-bench")
    if out.resolve() == scene.resolve() or (out / PROJECT_FILE).is_file():
        raise ProjectError(f"{out} is a scene. Choose another folder for the comparison with --out.")
    settings = BenchSettings(
        presets=tuple(name.strip() for name in options.presets.split(",") if name.strip()),
        wants_objects=not options.no_objects,
        everything=options.everything,
        seeds=_seeds(options.seeds),
        limit_minutes=options.limit,
        camera_model=options.cameras,
        photo_masks=options.photo_masks,
    )
    rows = compare(scene, out, settings, emit=emit, should_stop=should_stop)
    file = write_comparison(out, rows, title=_title(scene), command=_command(options), doc=options.doc)
    measured = savings(rows)
    if is_project and measured:
        with ProjectFolder.open_existing(scene) as project:
            # Its report says then what leaving out saved, measured.
            project.put("measured_savings", measured)
    outputs = {"table": str(file), "rows": [row.name for row in rows], "savings": measured}
    emit(Finished(markdown(rows), outputs))
    return 0


def _seeds(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in text.split(",") if word.strip())
    except ValueError:
        raise SettingsError(f"--seeds takes numbers like 0,1,2, got {text}.") from None


def _title(scene: Path) -> str:
    name = scene.resolve().name
    return scene.resolve().parent.name if name.lower() in ("photos", "images", "project") else name


def _command(options: argparse.Namespace) -> str:
    """Return the command for the document, without where files lie on this machine."""
    words = ["python -m engine bench", f"{_title(options.scene)}/{options.scene.name}", f"--presets {options.presets}"]
    words += [f"--cameras {options.cameras.name}"] if options.cameras else []
    words += [f"--photo-masks {options.photo_masks.name}"] if options.photo_masks else []
    words += ["--no-objects"] if options.no_objects else []
    words += ["--everything"] if options.everything else []
    words += [f"--seeds {options.seeds}"] if options.seeds != "0" else []
    words += [f"--limit {options.limit:g}"] if options.limit is not None else []
    return " ".join(words)
