"""Verification of weight files: SHA-256, or size and format at first use.

Every weight file, SAM's included, is verified here before use: `find_problem` checks a stored file, `check_received` a
file that was just downloaded or copied. The expected hash is in the catalogue. A file without a hash in the catalogue
is trusted on first use: its size and format are checked and its hash is recorded beside it (`record_path`). As long as
the file is there, it and every new copy of it must match the record. Whoever deletes the file deletes this trust too,
so that a wrong file can always be replaced.
"""

from __future__ import annotations

from pathlib import Path
from typing import IO

from ...core.errors import ModelFileError
from ...core.files import file_sha256, read_json, write_json
from .catalogue import ModelFile
from .file_format import find_format_problem

# Hashing a file of 28 MB takes about 0.1 s. Once per process is enough while the file's size and modification time stay
# the same. Entries: path, modification time in ns, size, SHA-256.
_VERIFIED: set[tuple[str, int, int, str]] = set()


def record_path(path: Path) -> Path:
    """Return the path of the record of a weight file whose hash is not in the catalogue."""
    return path.with_name(path.name + ".trusted.json")


def has_record(path: Path) -> bool:
    """Return whether the weight file at `path` exists and its hash was recorded on its first use."""
    return path.is_file() and record_path(path).is_file()


def read_record(path: Path) -> tuple[int, str]:
    """Return the size and SHA-256 that the weight file at `path` had on first use.

    Raises
    ------
    FormatError
        When the record cannot be read.
    """
    advice = (
        f"It is the record of a model file's hash. Delete it together with {path.name}, then fetch the model again."
    )
    content = read_json(record_path(path), {"size": int, "sha256": str}, advice=advice)
    return content["size"], content["sha256"]


def write_record(path: Path, model: ModelFile, size: int, sha256: str) -> None:
    """Record the size and SHA-256 that the weight file at `path` must have from now on."""
    write_json(record_path(path), {"size": size, "sha256": sha256, "source": model.source})


def expected_size_and_sha256(model: ModelFile, path: Path) -> tuple[int, str] | None:
    """Return the size and SHA-256 that `model` must have at `path`; None before its first use.

    Raises
    ------
    FormatError
        When the record of the first use cannot be read.
    """
    if model.size is not None and model.sha256 is not None:
        return model.size, model.sha256
    return read_record(path) if has_record(path) else None


def find_problem(model: ModelFile, path: Path) -> str | None:
    """Verify the file at `path` as a copy of `model`.

    Returns
    -------
    str or None
        None when size and SHA-256 are as expected; otherwise the predicate of a sentence about the file.

    Raises
    ------
    FormatError
        When the record of the first use cannot be read.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    if not path.is_file():
        return "is not a file"
    expected = expected_size_and_sha256(model, path)
    if expected is None:
        return f"was copied here by hand and has no recorded hash ({record_path(path).name})"
    size, sha256 = expected
    if status.st_size != size:
        return f"is damaged ({status.st_size:,} bytes, must be {size:,})"
    verified = (str(path), status.st_mtime_ns, status.st_size, sha256)
    if verified in _VERIFIED:
        return None
    try:
        matches = file_sha256(path) == sha256
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    if not matches:
        source = "in the catalogue" if model.sha256 else "recorded on first use"
        return f"is damaged (its SHA-256 differs from the one {source})"
    _VERIFIED.add(verified)
    return None


def refused(model: ModelFile, origin: object, reason: str, advice: str = "") -> ModelFileError:
    """Return the error for a file that came from `origin` and is not accepted as `model`.

    Parameters
    ----------
    origin : object
        A URL, a package or a path.
    reason : str
        The predicate of a sentence about the file.
    advice : str
        One sentence; empty for the usual one.
    """
    usual = f"Run again: python -m engine models fetch {model.name}"
    return ModelFileError(f"{model.name} from {origin} {reason}. It was not kept. {advice or usual}")


def check_received(model: ModelFile, path: Path, size: int, sha256: str, *, content: IO[bytes], origin: object) -> None:
    """Check a received copy of `model` before it is moved to `path`; on first use, record its hash.

    Parameters
    ----------
    path : Path
        Where the file will be stored. If a file is stored there already, its record applies to the new copy.
    size : int
        Size of the copy in bytes.
    sha256 : str
        SHA-256 of the copy.
    content : binary stream
        The copy itself. Only used, and then needs to be seekable, at the first use.
    origin : object
        Where the copy comes from, for the message.

    Raises
    ------
    ModelFileError
        When size or SHA-256 differ from the catalogue or from the record of the first use, or when, at first use, the
        size or the format is not the one in the catalogue.
    FormatError
        When the record of the first use cannot be read.
    """
    expected = expected_size_and_sha256(model, path)
    if expected is None:
        problem = find_size_problem(model, size)
        if problem is None:
            content.seek(0)
            problem = find_format_problem(model.file, content)
        if problem is not None:
            raise refused(model, origin, problem)
        write_record(path, model, size, sha256)
    elif expected != (size, sha256):
        received = f"({size:,} bytes, SHA-256 {sha256[:12]}...)"
        if model.sha256 is not None:
            raise refused(model, origin, f"is not the file listed in the catalogue {received}")
        raise refused(
            model,
            origin,
            f"is not the file that was trusted on first use {received}",
            f"Run again, or delete {path} first if you trust the new file: python -m engine models fetch {model.name}",
        )


def find_size_problem(model: ModelFile, size: int) -> str | None:
    """Return None when `model` may have `size` bytes; otherwise the predicate of a sentence about the file."""
    smallest, largest = model.size_limits
    if smallest <= size <= largest:
        return None
    return f"has {size:,} bytes, and the catalogue says {model.size_in_words}"
