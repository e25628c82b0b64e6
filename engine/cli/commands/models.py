"""``models``: list, fetch and verify weight files."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import HeritageError, ModelFileError, SettingsError
from ...core.events import Emit, Finished, StopCheck, part_of

if TYPE_CHECKING:
    from ...install.models import ModelFile

NAME = "models"
_EVALUATE = "evaluate-words"
_DEMO_ROOMS = ("museum_room", "store_room")
HELP = "List, fetch or verify the weight files the engine uses, or measure those that find words."
EXAMPLE = "python -m engine models fetch"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument(
        "action",
        choices=("list", "fetch", "verify", _EVALUATE),
        help=f"{_EVALUATE}: print how many words models find on the true outlines of rooms",
    )
    parser.add_argument(
        "names",
        nargs="*",
        help="models or files from `models list` (default: all that are not optional; "
        f"{_EVALUATE}: all stored models for words that describe crops)",
    )
    parser.add_argument(
        "--rooms",
        nargs="+",
        type=Path,
        default=[],
        metavar="FOLDER",
        help=f"{_EVALUATE}: folders with `photos` and `truth` (default: the rooms in demo of the repository)",
    )
    parser.add_argument(
        "--from",
        dest="offline",
        type=Path,
        metavar="FOLDER",
        help="fetch: copy the files from FOLDER, downloaded on another computer, without using the network (default: "
        "all model files in FOLDER); downloads use the proxies in HTTPS_PROXY and NO_PROXY",
    )


def _select_models(options: argparse.Namespace) -> list[ModelFile]:
    """Return the models that the arguments name or imply."""
    from ...install.models import CATALOGUE, find_model_files, folder_contains, models_folder

    if options.names:
        selected = {model.name: model for name in options.names for model in find_model_files(name)}
        return list(selected.values())
    if options.offline is not None:
        offered = [model for model in CATALOGUE.values() if folder_contains(options.offline, model)]
        if not offered:
            raise ModelFileError(f"The folder {options.offline} contains no model file of the catalogue.")
        return offered
    return [
        model
        for model in CATALOGUE.values()
        if options.action == "list"
        or not model.optional
        # A stored file is verified even if it is optional.
        or (options.action == "verify" and (models_folder() / model.file).exists())
    ]


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """List, fetch or verify the selected weight files."""
    from ...install.models import fetch, locate

    if options.action == _EVALUATE:
        return _evaluate_words(options, emit, should_stop)
    if options.rooms:
        raise ModelFileError(f"--rooms can only be used with `models {_EVALUATE}`.")
    if options.offline is not None:
        if options.action != "fetch":
            raise ModelFileError("--from can only be used with `models fetch`.")
        if not options.offline.is_dir():
            raise ModelFileError(
                f"There is no folder {options.offline}. Name the folder that contains the model files."
            )
    models = _select_models(options)
    lines: list[str] = []
    states: dict[str, str] = {}
    problems: list[str] = []
    for index, model in enumerate(models):
        if options.action == "fetch":
            path = fetch(
                model.name,
                emit=part_of(emit, index, len(models)),
                should_stop=should_stop,
                offline=options.offline,
                network=options.offline is None,
            )
            states[model.name] = str(path)
            lines.append(f"{model.name}: {path.stat().st_size / 1e6:.1f} MB, {path}")
            continue
        try:
            states[model.name] = str(locate(model.name))
        except HeritageError as error:
            states[model.name] = str(error)
            problems.append(model.name)
        kind = f"optional, {model.size_in_words}" if model.optional else model.size_in_words
        lines.append(f"{model.name}: {kind}, {model.licence} ({model.who_may_use}), {model.source}, {model.pin}")
        lines.append(f"    {states[model.name]}")
    emit(Finished("\n".join(lines), {"models": states, "problems": problems}))
    return 1 if problems and options.action == "verify" else 0


def _evaluate_words(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Print the table of models on rooms."""
    if find_spec("...quality", __package__) is None:
        raise SettingsError(f"`models {_EVALUATE}` needs a checkout of the repository: the extension has no rooms.")
    repository = Path(__file__).parents[3]
    rooms = options.rooms or [repository / "demo" / name for name in _DEMO_ROOMS]
    for room in rooms:
        if not ((room / "photos").is_dir() and (room / "truth").is_dir()):
            raise SettingsError(f"{room} has no folders photos and truth. Name rooms of the repository with --rooms.")
    from ...objects.grounding import load_detector, stored_describers
    from ...quality.evaluation import evaluate_outlines, outline_table

    detectors = [(name, partial(load_detector, name)) for name in options.names or stored_describers()]
    figures = []
    for number, room in enumerate(rooms):
        figures += evaluate_outlines(room, detectors, part_of(emit, number, len(rooms)), should_stop)
    emit(Finished(outline_table(figures), {"figures": [asdict(one) for one in figures]}))
    return 0
