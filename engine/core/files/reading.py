"""The readers of bytes, text and JSON: size and shape are checked before anything large is allocated.

Every failure is a `FormatError` with the file, the place and what to do. Arrays are read in `engine.core.files.arrays`.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NoReturn

from ..errors import FormatError
from .schema import Schema, check

_MAX_TEXT_BYTES = 16 << 20
_MAX_DECODED_BYTES = 192 << 20
_BYTES_PER_MARK = {b"{": 232, b"[": 88, b",": 40, b":": 40, b'"': 40}
"""Bytes that CPython allocates at most for each object, list, separator and half a string of a JSON text."""

_MAY_BE_INFINITE = re.compile(r"\d[eE]\+?\d\d|\d{200}")
"""The numbers of a JSON text that Python may read as infinity are among these."""


@contextlib.contextmanager
def opened(path: Path, *, advice: str) -> Iterator[IO[bytes]]:
    """Open a file for reading and turn errors of the operating system into a `FormatError`.

    Parameters
    ----------
    path : Path
        A regular file; a pipe or a device would block or never end.
    advice : str
        One or more sentences: what the user should do about a file that cannot be read.

    Raises
    ------
    FormatError
        When it cannot be opened or read.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise FormatError(f"{path} cannot be read: it is not a file. {advice}")
        with path.open("rb") as stream:
            yield stream
    # ValueError: a null character in the name.
    except (OSError, ValueError) as error:
        raise FormatError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}. {advice}") from error


@contextlib.contextmanager
def mapped(path: Path, *, advice: str) -> Iterator[mmap.mmap]:
    """Map a file that is not empty into memory, for reading; raises `FormatError` as `opened` does.

    The file is opened anew: on Windows, mapping an open file moves its position, which readers of it do not expect.
    """
    with opened(path, advice=advice) as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        yield data


def read_bytes(path: Path, *, max_bytes: int, advice: str) -> bytes:
    """Return the content of a file of at most `max_bytes`.

    Raises
    ------
    FormatError
        When it cannot be read or is larger.
    """
    with opened(path, advice=advice) as stream:
        # Not its size alone: the file may grow meanwhile.
        data = stream.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise FormatError(f"{path} cannot be read: it is larger than {max_bytes / 1e6:.0f} MB. {advice}")
    return data


def read_text(path: Path, *, advice: str, max_bytes: int = _MAX_TEXT_BYTES) -> str:
    """Return the content of a UTF-8 text file of at most `max_bytes`; raises `FormatError` as `read_bytes` does."""
    data = read_bytes(path, max_bytes=max_bytes, advice=advice)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path} cannot be read: byte {error.start} is not UTF-8 text. {advice}") from error


def read_json(path: Path, schema: Schema, *, advice: str) -> Any:
    """Return the JSON value in a file.

    Parameters
    ----------
    path : Path
        At most 16 MB of UTF-8.
    schema : Schema
        What the value must be, see `engine.core.files.schema`.
    advice : str
        One or more sentences: what the user should do about a damaged file.

    Raises
    ------
    FormatError
        When the file cannot be read, is not JSON, or is not what `schema` says.
    """
    return parse_json(read_text(path, advice=advice), schema, source=str(path), advice=advice)


def parse_json(text: str, schema: Schema, *, source: str, advice: str) -> Any:
    """Return the JSON value of a text that was stored inside of another file or sent by another process.

    Parameters
    ----------
    source : str
        Where the text comes from, for the message.

    Raises
    ------
    FormatError
        When it is not JSON, is not what `schema` says, or would take more than 192 MB.
    """
    try:
        data = text.encode("utf-8")
        decoded = len(data) + sum(size * data.count(mark) for mark, size in _BYTES_PER_MARK.items())
        if len(data) > _MAX_TEXT_BYTES or decoded > _MAX_DECODED_BYTES:
            raise ValueError("it is too large")
        value = json.loads(text, parse_constant=_refuse_constant)
        # Half of a surrogate pair, "\ud800", can be neither shown nor written.
        if "\\u" in text:
            json.dumps(value, ensure_ascii=False).encode("utf-8")
        problem = check(value, schema)
        if not problem and _MAY_BE_INFINITE.search(text):
            # Also where the schema allows everything: infinity could not be written again.
            json.dumps(value, allow_nan=False)
    except RecursionError as error:
        raise FormatError(f"{source} cannot be read: it is nested too deeply. {advice}") from error
    except UnicodeEncodeError as error:
        raise FormatError(f"{source} cannot be read: it has a character that is not valid. {advice}") from error
    except ValueError as error:
        raise FormatError(f"{source} cannot be read: {error}. {advice}") from error
    if problem:
        raise FormatError(f"{source} cannot be read: {problem}. {advice}")
    return value


def _refuse_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is not a JSON number")
