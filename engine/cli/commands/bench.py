"""``bench``: compares training presets on one scene, error against run time."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...core.errors import ProjectError, SettingsError
from ...core.events import Emit, Finished, StopCheck
from ...project.folder import PROJECT_FILE, ProjectFolder
from ...quality.bench.settings import BenchSettings
from .scene_options import add_camera_options, add_device_option, add_no_objects_option, describe_presets

NAME = "bench"
HELP = "Train presets on one scene and compare their error against run time; finished runs are kept."
EXAMPLE = "python -m engine bench photos --presets preview,standard,best --limit 30 --out comparison"
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("scene", type=Path, help="folder with photos, or a project folder, which is only read")
    parser.add_argument(
        "--presets",
        default="preview,standard",
        metavar="NAME,NAME",
        help=f"presets to compare. {describe_presets()} (default: %(default)s)",
    )
    parser.add_argument("--out", type=Path, help="folder for the runs and tables (default: SCENE-bench beside it)")
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write the table and its picture there")
    add_camera_options(parser)
    add_no_objects_option(parser)
    add_device_option(parser)
    parser.add_argument("--limit", type=float, metavar="MINUTES", help="stop the training of a preset after this time")
    parser.add_argument(
        "--everything",
        action="store_true",
        help="train each preset once more with nothing left out, to measure what leaving out saves and costs",
    )
    parser.add_argument(
        "--random-seeds",
        default="0",
        metavar="N,N",
        help="train each preset once with each of these seeds (default: %(default)s)",
    )


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Compare, write the table and print it."""
    from ...quality.bench import compare, markdown, savings, write_comparison

    scene: Path = options.scene
    is_project = (scene / PROJECT_FILE).is_file()
    if is_project and options.cameras is not None:
        raise SettingsError(
            f"{scene} is a project and has its cameras. Leave out --cameras, or give the folder with its photos."
        )
    if is_project and options.photo_masks is not None:
        raise SettingsError(
            f"{scene} is a project and has its masks. Leave out --photo-masks, or give the folder with its photos."
        )
    out: Path = options.out or scene.resolve().with_name(f"{scene.resolve().name}-bench")
    if out.resolve() == scene.resolve() or (out / PROJECT_FILE).is_file():
        raise ProjectError(f"{out} is a scene. Choose another folder for the comparison with --out.")
    settings = BenchSettings(
        presets=tuple(name.strip() for name in options.presets.split(",") if name.strip()),
        wants_objects=not options.no_objects,
        everything=options.everything,
        random_seeds=_random_seeds(options.random_seeds),
        limit_minutes=options.limit,
        device=options.device,
        given_cameras=options.cameras,
        photo_masks=options.photo_masks,
    )
    rows = compare(scene, out, settings, emit=emit, should_stop=should_stop)
    file = write_comparison(out, rows, title=_title(scene), command=_command(options), doc=options.doc)
    measured = savings(rows)
    if is_project and measured:
        with ProjectFolder.open_existing(scene) as project:
            # The report of the project then states the measured savings.
            project.put("measured_savings", measured)
    outputs = {"table": str(file), "rows": [row.name for row in rows], "savings": measured}
    emit(Finished(markdown(rows), outputs))
    return 0


def _random_seeds(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in text.split(",") if word.strip())
    except ValueError:
        raise SettingsError(f"--random-seeds takes numbers like 0,1,2, got {text}.") from None


def _title(scene: Path) -> str:
    name = scene.resolve().name
    return scene.resolve().parent.name if name.lower() in ("photos", "images", "project") else name


def _command(options: argparse.Namespace) -> str:
    """Return the command for the document, without the paths of this machine."""
    words = ["python -m engine bench", f"{_title(options.scene)}/{options.scene.name}", f"--presets {options.presets}"]
    words += [f"--cameras {options.cameras.name}"] if options.cameras else []
    words += [f"--photo-masks {options.photo_masks.name}"] if options.photo_masks else []
    words += ["--no-objects"] if options.no_objects else []
    words += ["--everything"] if options.everything else []
    words += [f"--random-seeds {options.random_seeds}"] if options.random_seeds != "0" else []
    words += [f"--device {options.device}"] if options.device != "auto" else []
    words += [f"--limit {options.limit:g}"] if options.limit is not None else []
    return " ".join(words)
