"""``models``: list, fetch and verify weight files."""

from __future__ import annotations

import argparse
from dataclasses import replace

from ..errors import HeritageError
from ..events import Emit, Event, Finished, Progress, StopCheck

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "models"
HELP = "List, fetch or verify the weight files the engine uses."
EXAMPLE = "python -m engine models fetch"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("action", choices=("list", "fetch", "verify"))
    parser.add_argument("names", nargs="*", help="names from `models list` (default: all)")


def project_folder(options: argparse.Namespace) -> None:
    """No project, no log."""


def _share_of(emit: Emit, done: int, count: int) -> Emit:
    """Return an `Emit` for one of `count` files, `done` of which are there: one bar for all of them."""

    def tell(event: Event) -> None:
        emit(replace(event, fraction=(done + event.fraction) / count) if isinstance(event, Progress) else event)

    return tell


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """List, fetch or verify."""
    from ..models.catalogue import CATALOGUE, fetch, find, locate

    models = [find(name) for name in options.names] or list(CATALOGUE.values())
    lines: list[str] = []
    states: dict[str, str] = {}
    failed = False
    for done, model in enumerate(models):
        if options.action == "fetch":
            path = fetch(model.name, emit=_share_of(emit, done, len(models)), should_stop=should_stop)
            states[model.name] = str(path)
            lines.append(f"{model.name}: {model.size / 1e6:.1f} MB, {path}")
            continue
        try:
            states[model.name] = str(locate(model.name))
        except HeritageError as error:
            states[model.name] = str(error)
            failed = failed or options.action == "verify"
        lines.append(f"{model.name}: {model.size / 1e6:.1f} MB, {model.licence} ({model.who_may_use}), {model.source}")
        lines.append(f"    {states[model.name]}")
    emit(Finished("\n".join(lines), {"models": states}))
    return 1 if failed else 0
