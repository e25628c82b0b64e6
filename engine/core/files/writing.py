"""Writing files: under a temporary name first, so that no file is ever half-written."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from ..errors import DiskError
from ..system import advice_for, delete_file, replace_file

TEMPORARY_PREFIX = ".writing-"


@contextlib.contextmanager
def atomic_write(path: Path, mode: str = "wb", *, private: bool = False) -> Iterator[IO[Any]]:
    """Open a temporary file beside `path` that becomes `path` when the block ends without an error.

    Parameters
    ----------
    path : Path
        Its folder is created when missing.
    mode : {"wb", "w"}
        Text is UTF-8.
    private : bool
        Whether only the user may read it, from its first byte on: keys and hashes of tokens.

    Raises
    ------
    DiskError
        When the disk is full, read-only or unreachable. `path` is unchanged then.
    """
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.parent / f"{TEMPORARY_PREFIX}{secrets.token_hex(8)}{path.suffix}"
        # The system applies the umask. To ask for it is to change it, for all threads.
        opener = _open_private if private else None
        with open(new, mode.replace("w", "x"), encoding=None if "b" in mode else "utf-8", opener=opener) as stream:
            temporary = new
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        replace_file(temporary, path)
        temporary = None
    except OSError as error:
        raise write_problem(path, error) from error
    finally:
        if temporary is not None:
            # What cannot be deleted now is deleted by the next run in this project.
            with contextlib.suppress(OSError):
                delete_file(temporary)


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def write_problem(path: Path, error: OSError) -> DiskError:
    """Return the error to raise when `path` could not be written: with the reason, and what to do about it."""
    return DiskError(f"Could not write {path}: {error.strerror or error}. {advice_for(error, path)}")


def write_file(path: Path, content: bytes | memoryview | str) -> None:
    """Write `content` to `path`, text as UTF-8; raises as `atomic_write` does."""
    with atomic_write(path, "w" if isinstance(content, str) else "wb") as stream:
        stream.write(content)


def write_json(path: Path, data: Any, *, private: bool = False) -> None:
    """Write `data` to `path` as indented UTF-8 JSON, atomically; `private` as of `atomic_write`.

    Raises
    ------
    ValueError
        When a number is not finite: JSON has no NaN, and other programs reject files with one.
    DiskError
        When the file cannot be written.
    """
    with atomic_write(path, "w", private=private) as stream:
        json.dump(data, stream, indent=1, ensure_ascii=False, allow_nan=False)


def finite_or_null(value: Any) -> Any:
    """Return the JSON value `value` with None in place of every number that is not finite."""
    if isinstance(value, dict):
        return {key: finite_or_null(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite_or_null(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file, read in chunks."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while chunk := stream.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()
