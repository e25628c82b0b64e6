"""``evaluate``: isolate objects whose true masks are known, and compare; the project stays as it is."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from ..errors import SettingsError
from ..events import Emit, Finished, StopCheck
from ..masks.settings import SAM_MODELS
from ..project_folder import ProjectFolder
from .chosen_models import add_sam_argument, models_of

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "evaluate"
HELP = "Isolate the objects that true masks are known of, in several ways, and compare; nothing is stored."
EXAMPLE = "python -m engine evaluate scene demo/museum_room/truth --presets paper,better --ablations"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`; it is only read")
    parser.add_argument("truth", type=Path, help="folder with true masks of its photos")
    layouts = ("auto", "museum", "lerf-mask", "3d-ovs", "lerf-ovs")
    parser.add_argument("--layout", choices=layouts, default="auto", help="of the masks (default: recognise it)")
    parser.add_argument("--presets", default="paper,better", help="ways to isolate (default: %(default)s)")
    parser.add_argument(
        "--seed", choices=("text", "mask", "click"), default="mask", help="how to ask (default: %(default)s)"
    )
    parser.add_argument(
        "--views",
        choices=("held-out", "all"),
        default="held-out",
        help="where to compare: photos that training did not see, or all (default: %(default)s)",
    )
    parser.add_argument("--ablations", action="store_true", help="also `better` without one ingredient at a time")
    parser.add_argument(
        "--view-counts", default="", metavar="N,N", help="also with so many photos looked at, e.g. 1,2,4,8,16"
    )
    add_sam_argument(parser)
    parser.add_argument("--objects", default="", help='only these, e.g. "vase;bust"')
    parser.add_argument("--doc", type=Path, metavar="FILE.md", help="also write this scene's section there")


def project_folder(options: argparse.Namespace) -> None:
    """No log: the project is only read."""


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Compare, tell and write."""
    from ..evaluation import evaluate_project, markdown, write_evaluation
    from ..evaluation.settings import EvaluationSettings

    if options.doc is not None and options.doc.is_dir():
        raise SettingsError(f"{options.doc} is a folder. Choose a file name.")
    project = ProjectFolder.open_existing(options.project)
    settings = EvaluationSettings(
        presets=tuple(name.strip() for name in options.presets.split(",") if name.strip()),
        seed=options.seed,
        views=options.views,
        ablations=options.ablations,
        view_counts=_counts(options.view_counts),
        objects=tuple(name.strip() for name in options.objects.split(";") if name.strip()),
    )
    evaluation = evaluate_project(
        project,
        options.truth,
        settings,
        layout=options.layout,
        **models_of(options),
        emit=emit,
        should_stop=should_stop,
    )
    outputs = {}
    if options.doc is not None:
        write_evaluation(options.doc, evaluation, title=_title(project.path), command=_command(options))
        outputs["table"] = str(options.doc)
    emit(Finished(markdown(evaluation), outputs))
    return 0


def _counts(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(count) for count in text.split(",") if count.strip())
    except ValueError:
        raise SettingsError(
            f"--view-counts {text!r} are no numbers. Write for example: --view-counts 1,2,4,8."
        ) from None


def _title(project: Path) -> str:
    name = project.resolve().name
    return project.resolve().parent.name if name.lower() == "project" else name


def _command(options: argparse.Namespace) -> str:
    """Return the command for the document, without where files lie on this machine."""
    words = ["python -m engine evaluate", _short(options.project), _short(options.truth)]
    words += [f"--layout {options.layout}"] if options.layout != "auto" else []
    words += [f"--presets {options.presets}", f"--seed {options.seed}", f"--views {options.views}"]
    words += ["--ablations"] if options.ablations else []
    words += [f"--view-counts {options.view_counts}"] if options.view_counts else []
    words += [f"--sam {options.sam}"] if options.sam != SAM_MODELS[0] else []
    words += [f"--objects {shlex.quote(options.objects)}"] if options.objects else []
    return " ".join([*words, f"--doc {_short(options.doc, 1)}"])


def _short(path: Path, n_parts: int = 2) -> str:
    """Return a path from where the command was given, or the last parts of one that lies elsewhere."""
    whole, here = path.resolve(), Path.cwd().resolve()
    kept = whole.relative_to(here) if whole.is_relative_to(here) else Path(*whole.parts[-n_parts:])
    return shlex.quote(kept.as_posix())
