"""``models``: list, fetch and verify weight files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import HeritageError, ModelFileError
from ...core.events import Emit, Finished, StopCheck, part_of

if TYPE_CHECKING:
    from ...install.models import ModelFile

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "run"]

NAME = "models"
HELP = "List, fetch or verify the weight files the engine uses."
EXAMPLE = "python -m engine models fetch"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("action", choices=("list", "fetch", "verify"))
    parser.add_argument(
        "names", nargs="*", help="models or files from `models list` (default: all that are not optional)"
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
