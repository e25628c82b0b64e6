"""SHA-256 verification of weight files.

Every weight file, SAM's included, is verified here before use: `find_problem` checks a stored file, `check_received` a
file that was just downloaded or copied. The expected hash is in the catalogue. A file without a hash in the catalogue
is trusted on first use: its hash is recorded beside it (`record_path`), and from then on the file must match it.
"""

from __future__ import annotations

import json
from pathlib import Path

from ..errors import ModelFileError
from ..files import file_sha256, write_json
from .catalogue import ModelFile

__all__ = [
    "check_received",
    "expected_size_and_sha256",
    "find_problem",
    "has_record",
    "read_record",
    "record_path",
    "write_record",
]

# Hashing a file of 28 MB takes about 0.1 s. Once per process is enough while the file's size and modification time stay
# the same. Entries: path, modification time in ns, size, SHA-256.
_VERIFIED: set[tuple[str, int, int, str]] = set()


def record_path(path: Path) -> Path:
    """Return the path of the record of a weight file whose hash is not in the catalogue."""
    return path.with_name(path.name + ".trusted.json")


def has_record(path: Path) -> bool:
    """Return whether the hash of the weight file at `path` was recorded on an earlier first use."""
    return record_path(path).is_file()


def read_record(path: Path) -> tuple[int, str]:
    """Return the size and SHA-256 that the weight file at `path` had on first use.

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
    """Record the size and SHA-256 that the weight file at `path` must have from now on."""
    write_json(record_path(path), {"size": size, "sha256": sha256, "source": model.source})


def expected_size_and_sha256(model: ModelFile, path: Path) -> tuple[int, str] | None:
    """Return the size and SHA-256 that `model` must have at `path`; None before its first use."""
    if model.size is not None and model.sha256 is not None:
        return model.size, model.sha256
    return read_record(path) if has_record(path) else None


def find_problem(model: ModelFile, path: Path) -> str | None:
    """Verify the file at `path` as a copy of `model`.

    Returns
    -------
    str or None
        None when size and SHA-256 are as expected; otherwise the predicate of a sentence about the file.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
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


def check_received(model: ModelFile, path: Path, size: int, sha256: str) -> None:
    """Check a received copy of `model` before it is moved to `path`; on first use, record its hash.

    Raises
    ------
    ModelFileError
        When size or SHA-256 differ from the catalogue or from the record of the first use.
    """
    expected = expected_size_and_sha256(model, path)
    if expected is None:
        write_record(path, model, size, sha256)
    elif expected != (size, sha256):
        source = "listed in the catalogue" if model.sha256 is not None else "that was trusted on first use"
        raise ModelFileError(
            f"{model.name} from {model.source} is not the file {source} ({size:,} bytes, SHA-256 {sha256[:12]}...). It "
            f"was not kept. Run again: python -m engine models fetch {model.name}"
        )
