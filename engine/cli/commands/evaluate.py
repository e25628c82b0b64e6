"""``evaluate``: isolate objects and compare them with ground-truth masks; the project is only read."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import get_args

from ...core.errors import SettingsError
from ...core.events import Emit, Finished, StopCheck
from ...core.words import split_list
from ...masks.settings import SAM_MODELS
from ...project.folder import ProjectFolder
from ...quality.evaluation.settings import Layout, PromptKind, Views
from .chosen_models import add_sam_argument, model_factories
from .scene_options import add_device_option

NAME = "evaluate"
HELP = "Isolate the objects of a ground truth with several methods and compare them; the project is only read."
EXAMPLE = "python -m engine evaluate scene demo/museum_room/truth --presets paper,better --ablations"
USES_CAMERAS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`; it is only read")
    parser.add_argument("truth", type=Path, help="folder with ground-truth masks of its photos")
    layouts = ("auto", *get_args(Layout))
    parser.add_argument(
        "--layout", choices=layouts, default="auto", help="layout of the ground truth (default: detected)"
    )
    parser.add_argument("--presets", default="paper,better", help="methods to compare (default: %(default)s)")
    parser.add_argument(
        "--prompt-kind",
        choices=get_args(PromptKind),
        default="mask",
        help="kind of prompt that asks for each object; text also asks for the absent things that TRUTH/absent.json "
        "lists; all searches for all objects without a prompt (default: %(default)s)",
    )
    parser.add_argument(
        "--views",
        choices=get_args(Views),
        default="held-out",
        help="photos to compare in: those that training did not see, which isolating does not look at either; or all "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--ablations", action="store_true", help="also the preset better without one ingredient at a time"
    )
    parser.add_argument(
        "--view-counts", default="", metavar="N,N", help="also with these numbers of photos, e.g. 1,2,4,8,16"
    )
    add_sam_argument(parser)
    # Not `auto`: tables of several computers are compared, and they hold times.
    add_device_option(parser, "render views and count votes", default="cpu")
    parser.add_argument("--objects", default="", help='only these objects, e.g. "vase;teapot"')
    parser.add_argument(
        "--doc", type=Path, metavar="FILE.md", help="also write the section of this scene into this file"
    )
    parser.add_argument(
        "--results", type=Path, metavar="FILE.json", help="also write every figure into this file, as JSON"
    )


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Compare, print the table and write it."""
    from ...quality.evaluation import evaluate_project, markdown, write_evaluation, write_results
    from ...quality.evaluation.settings import EvaluationSettings
    from ...rasterizer import choose_device

    for file in (options.doc, options.results):
        if file is not None and file.is_dir():
            raise SettingsError(f"{file} is a folder. Choose a file name.")
    project = ProjectFolder.open_existing(options.project)
    project.require_intact("cameras", "training")
    settings = EvaluationSettings(
        presets=tuple(name.strip() for name in options.presets.split(",") if name.strip()),
        prompt_kind=options.prompt_kind,
        views=options.views,
        ablations=options.ablations,
        view_counts=_counts(options.view_counts),
        objects=tuple(split_list(options.objects)),
    )
    evaluation = evaluate_project(
        project,
        options.truth,
        settings,
        layout=options.layout,
        **model_factories(options),
        emit=emit,
        should_stop=should_stop,
        device=choose_device(options.device),
    )
    outputs = {}
    if options.doc is not None:
        write_evaluation(options.doc, evaluation, title=_title(project.path), command=_command(options))
        outputs["table"] = str(options.doc)
    if options.results is not None:
        write_results(options.results, evaluation)
        outputs["results"] = str(options.results)
    emit(Finished(markdown(evaluation), outputs))
    return 0


def _counts(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(count) for count in text.split(",") if count.strip())
    except ValueError:
        raise SettingsError(
            f"--view-counts {text!r} is not a list of numbers. Write for example: --view-counts 1,2,4,8."
        ) from None


def _title(project: Path) -> str:
    name = project.resolve().name
    return project.resolve().parent.name if name.lower() == "project" else name


def _command(options: argparse.Namespace) -> str:
    """Return the command for the document, without absolute paths."""
    words = ["python -m engine evaluate", _short(options.project), _short(options.truth)]
    words += [f"--layout {options.layout}"] if options.layout != "auto" else []
    words += [f"--presets {options.presets}", f"--prompt-kind {options.prompt_kind}", f"--views {options.views}"]
    words += ["--ablations"] if options.ablations else []
    words += [f"--view-counts {options.view_counts}"] if options.view_counts else []
    words += [f"--sam {options.sam}"] if options.sam != SAM_MODELS[0] else []
    words += [f"--device {options.device}"] if options.device != "cpu" else []
    words += [f"--objects {shlex.quote(options.objects)}"] if options.objects else []
    return " ".join([*words, f"--doc {_short(options.doc, 1)}"])


def _short(path: Path, n_parts: int = 2) -> str:
    """Return `path` relative to the working directory, or its last parts when it lies elsewhere."""
    whole, here = path.resolve(), Path.cwd().resolve()
    kept = whole.relative_to(here) if whole.is_relative_to(here) else Path(*whole.parts[-n_parts:])
    return shlex.quote(kept.as_posix())
