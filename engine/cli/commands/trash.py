"""``trash``: list, restore or delete for good the objects that were deleted or replaced."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...core.errors import SettingsError
from ...core.events import Emit, Finished, StopCheck
from ...project.folder import ProjectFolder

NAME = "trash"
HELP = "List the objects that were deleted or replaced, restore one, or delete them for good."
EXAMPLE = "python -m engine trash restore scene vase"
LOG_IN = "project"

_MAX_DAYS = 36_500


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("action", choices=("list", "restore", "empty"))
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    parser.add_argument(
        "object", nargs="?", help="restore: number in the list, or name; of several with one name, the last deleted"
    )
    parser.add_argument(
        "--older-than", type=float, metavar="DAYS", help="empty: only what was deleted more than DAYS days ago"
    )


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """List, restore or empty."""
    if (options.object is None) == (options.action == "restore"):
        raise SettingsError("`trash restore` requires the number or the name of one object; the others take none.")
    if options.older_than is not None and options.action != "empty":
        raise SettingsError("--older-than can only be used with `trash empty`.")
    days = 0.0 if options.older_than is None else options.older_than
    if not 0 <= days <= _MAX_DAYS:
        raise SettingsError(f"--older-than must be 0 to {_MAX_DAYS} days, got {days:g}.")
    with ProjectFolder.open_existing(options.project) as project:
        message, outputs = _ACTIONS[options.action](project, options.object, days)
    emit(Finished(message, outputs))
    return 0


def _list(project: ProjectFolder, name: str | None, days: float) -> tuple[str, dict[str, Any]]:
    from ...project.objects import list_trash

    entries = list_trash(project.path)
    lines = [
        f"{number}: {entry.name} ({entry.why}, {entry.deleted:%Y-%m-%d %H:%M} UTC, {_size(entry.n_bytes)})"
        for number, entry in enumerate(entries, 1)
    ]
    listed = [{"number": number, "id": entry.id, "name": entry.name} for number, entry in enumerate(entries, 1)]
    return "\n".join(lines) or "The trash is empty.", {"trash": listed}


def _restore(project: ProjectFolder, name: str, days: float) -> tuple[str, dict[str, Any]]:
    from ...project.objects import restore_object

    record = restore_object(project, name)
    return f"Restored {record.name}.", {"objects": [record.id]}


def _empty(project: ProjectFolder, name: str | None, days: float) -> tuple[str, dict[str, Any]]:
    from ...project.objects import empty_trash

    count, n_bytes = empty_trash(project, older_than_days=days)
    what = "1 object" if count == 1 else f"{count} objects"
    return f"Deleted {what} for good, {_size(n_bytes)}.", {"n_objects": count, "n_bytes": n_bytes}


_ACTIONS = {"list": _list, "restore": _restore, "empty": _empty}


def _size(n_bytes: int) -> str:
    return f"{n_bytes / 1e6:.1f} MB"
