"""``edit``: stores edits of objects that were made by hand."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from ...core.errors import SettingsError
from ...core.events import Emit, Finished, StopCheck
from ...project.folder import ProjectFolder

Number = TypeVar("Number", int, float)

NAME = "edit"
HELP = "Set which Gaussians an object has, rename or merge objects, or delete them; what is replaced goes to the trash."
EXAMPLE = "python -m engine edit scene --merge vase=lid --rename vase=Vase"
LOG_IN = "project"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument("project", type=Path, help="project folder made by `reconstruct`")
    parser.add_argument(
        "--set", action="append", default=[], metavar="ID=FILE.npy",
        help="membership of each Gaussian of the scene in this object, 0 to 1; a new id makes a new object",
    )  # fmt: skip
    parser.add_argument(
        "--merge", action="append", default=[], metavar="ID=ID", help="add the second object to the first"
    )
    parser.add_argument(
        "--threshold", action="append", default=[], metavar="ID=T",
        help="membership, 0 to 1, from which on a Gaussian belongs to this object",
    )  # fmt: skip
    parser.add_argument(
        "--level", action="append", default=[], metavar="ID=K",
        help="use this level of an object, 0 for the smallest part, without adding detail",
    )  # fmt: skip
    parser.add_argument("--rename", action="append", default=[], metavar="ID=NAME", help="give an object another name")
    parser.add_argument("--delete", action="append", default=[], metavar="ID", help="move an object to the trash")


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Store the edits."""
    import numpy as np

    from ...project.objects import load_membership, load_object, object_states
    from .stored_edits import read_membership, store_edits

    if not any((options.set, options.merge, options.threshold, options.level, options.rename, options.delete)):
        raise SettingsError("Give at least one of --set, --merge, --threshold, --level, --rename and --delete.")
    with ProjectFolder.open_existing(options.project) as project:
        memberships = {object_id: read_membership(Path(file)) for object_id, file in _pairs("--set", options.set)}
        deleted = list(options.delete)
        for target, other in _pairs("--merge", options.merge):
            ids = [load_object(project.path, name).id for name in (target, other)]
            if ids[0] == ids[1]:
                raise SettingsError(f"--merge takes two different objects, got {target!r} twice.")
            both = [memberships.get(one, load_membership(project.path, one)) for one in ids]
            memberships[ids[0]] = np.maximum(*both)
            deleted.append(ids[1])
        states = object_states(project.path)
        records = store_edits(
            project,
            memberships,
            names=dict(_pairs("--rename", options.rename)),
            deleted=deleted,
            thresholds=_numbers("--threshold", options.threshold, float),
            levels=_numbers("--level", options.level, int),
        )
    names = ", ".join(f"{record.name} ({record.n_gaussians:,} Gaussians)" for record in records)
    message = " ".join(
        [*([f"Stored {names}."] if names else []), *([f"Deleted {', '.join(deleted)}."] if deleted else [])]
    )
    # What stores an edit knows by these what to bring back from the trash when the edit is undone.
    deleted_states = [states[object_id] for object_id in deleted]
    outputs = {"objects": [record.id for record in records], "deleted": deleted, "deleted_states": deleted_states}
    emit(Finished(message, outputs))
    return 0


def _numbers(option: str, texts: Sequence[str], kind: Callable[[str], Number]) -> dict[str, Number]:
    """Return the numbers of texts of the form ``ID=NUMBER`` by id."""
    found = {}
    for object_id, text in _pairs(option, texts):
        try:
            found[object_id] = kind(text)
        except ValueError as error:
            raise SettingsError(f"{option} takes an id and a number with = between them, got {text!r}.") from error
    return found


def _pairs(option: str, texts: Sequence[str]) -> list[tuple[str, str]]:
    """Return the two parts of each text, which has the form ``A=B``."""
    parts = [text.partition("=") for text in texts]
    if wrong := next(("".join(part) for part in parts if not (part[0] and part[2])), None):
        raise SettingsError(f"{option} takes two parts with = between them, got {wrong!r}.")
    return [(first, second) for first, _, second in parts]
