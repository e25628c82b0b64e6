"""``edit``: stores edits of objects that were made by hand."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ..errors import SettingsError
from ..events import Emit, Finished, StopCheck
from ..project_folder import ProjectFolder

__all__ = ["EXAMPLE", "HELP", "NAME", "add_arguments", "project_folder", "run"]

NAME = "edit"
HELP = "Set which Gaussians an object has, rename or merge objects, or delete them; what is replaced goes to the trash."
EXAMPLE = "python -m engine edit scene --merge vase=lid --rename vase=Vase"

_ADVICE = "Write it again as a NumPy array of float32, one value for each Gaussian of the scene."


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
    parser.add_argument("--rename", action="append", default=[], metavar="ID=NAME", help="give an object another name")
    parser.add_argument("--delete", action="append", default=[], metavar="ID", help="move an object to the trash")


def project_folder(options: argparse.Namespace) -> Path:
    """Return the project whose log is written."""
    path: Path = options.project
    return path


def run(options: argparse.Namespace, emit: Emit, should_stop: StopCheck) -> int:
    """Store the edits."""
    import numpy as np

    from ..files import ArraySpec, read_array
    from ..objects import load_membership, load_object
    from .stored_edits import store_edits

    if not (options.set or options.merge or options.rename or options.delete):
        raise SettingsError("Give at least one of --set, --merge, --rename and --delete.")
    with ProjectFolder.open_existing(options.project) as project:
        memberships = {
            object_id: read_array(Path(file), ArraySpec("float32", ("n",), finite=True), advice=_ADVICE)
            for object_id, file in _pairs("--set", options.set)
        }
        deleted = list(options.delete)
        for target, other in _pairs("--merge", options.merge):
            ids = [load_object(project.path, name).id for name in (target, other)]
            if ids[0] == ids[1]:
                raise SettingsError(f"--merge takes two different objects, got {target!r} twice.")
            both = [memberships.get(one, load_membership(project.path, one)) for one in ids]
            memberships[ids[0]] = np.maximum(*both)
            deleted.append(ids[1])
        records = store_edits(project, memberships, names=dict(_pairs("--rename", options.rename)), deleted=deleted)
    names = ", ".join(f"{record.name} ({record.n_gaussians:,} Gaussians)" for record in records)
    message = " ".join(
        [*([f"Stored {names}."] if names else []), *([f"Deleted {', '.join(deleted)}."] if deleted else [])]
    )
    emit(Finished(message, {"objects": [record.id for record in records], "deleted": deleted}))
    return 0


def _pairs(option: str, texts: Sequence[str]) -> list[tuple[str, str]]:
    """Return the two parts of each text, which has the form ``A=B``."""
    parts = [text.partition("=") for text in texts]
    if wrong := next(("".join(part) for part in parts if not (part[0] and part[2])), None):
        raise SettingsError(f"{option} takes two parts with = between them, got {wrong!r}.")
    return [(first, second) for first, _, second in parts]
