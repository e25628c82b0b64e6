"""Whether a file is complete and of the format that its name says, without loading it.

For files whose hash is not known yet: a login page or a file that was cut off must not be trusted. The format's own
lengths are followed to the end of the file, so every cut is noticed. Our own, because the `onnx` package is needed by
tests only and reads the whole file into memory.
"""

from __future__ import annotations

import os
from typing import IO

from ...core.errors import FormatError
from ...core.files import parse_json

__all__ = ["find_format_problem"]

_MAX_JSON_BYTES = 16 << 20
_MAX_FIELDS = 1 << 17  # a model has some thousands; more of them would only take time
_VARINT, _EIGHT_BYTES, _LENGTH_AND_BYTES, _FOUR_BYTES = 0, 1, 2, 5  # wire types of Protocol Buffers
# Fields of `ModelProto` and of `GraphProto` in onnx.proto that every model has.
_IR_VERSION, _GRAPH, _OPSET_IMPORT = 1, 7, 8
_NODE, _OUTPUT = 1, 12


class _Damaged(Exception):
    """The bytes are not what the format says; the message is the predicate of a sentence."""


def find_format_problem(name: str, content: IO[bytes]) -> str | None:
    """Return None when a file is complete and of the format of its name.

    Parameters
    ----------
    name : str
        Ends in ``.onnx`` or, for a tokenizer, in ``.json``.
    content : binary stream
        Seekable, at its start.

    Returns
    -------
    str or None
        Otherwise the predicate of a sentence about the file.
    """
    suffix = os.path.splitext(name)[1]
    try:
        if suffix == ".onnx":
            _check_onnx(content)
        elif suffix == ".json":
            _check_tokenizer(content)
        else:
            raise _Damaged("has a format that is only accepted with a SHA-256 in the catalogue")
    except _Damaged as problem:
        return str(problem)
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
    return None


def _check_tokenizer(content: IO[bytes]) -> None:
    data = content.read(_MAX_JSON_BYTES + 1)
    try:
        # `parse_json` limits what it allocates.
        parse_json(data.decode("utf-8"), {"model": {"vocab": (list, dict)}}, source="it", advice="")
    except (UnicodeDecodeError, FormatError) as error:
        raise _Damaged("is not the JSON file of a tokenizer; it may be cut off or a web page") from error


def _check_onnx(content: IO[bytes]) -> None:
    end = content.seek(0, os.SEEK_END)
    model = _fields(content, 0, end)
    if not {_IR_VERSION, _GRAPH, _OPSET_IMPORT} <= model.keys():
        raise _Damaged("is not an ONNX model; it may be cut off or a web page")
    start, length = model[_GRAPH]
    if not {_NODE, _OUTPUT} <= _fields(content, start, start + length).keys():
        raise _Damaged("is an ONNX model without nodes or without outputs")


def _fields(content: IO[bytes], start: int, end: int) -> dict[int, tuple[int, int]]:
    """Return start and length of the last field of each number in the message between two places of the file."""
    found: dict[int, tuple[int, int]] = {}
    count = 0
    content.seek(start)
    while (place := content.tell()) < end:
        tag = _varint(content)
        number, wire_type = tag >> 3, tag & 7
        if wire_type == _VARINT:
            _varint(content)
            length = 0
        elif wire_type == _LENGTH_AND_BYTES:
            length = _varint(content)
        elif wire_type in (_EIGHT_BYTES, _FOUR_BYTES):
            length = 8 if wire_type == _EIGHT_BYTES else 4
        else:
            raise _Damaged(f"is not an ONNX model (byte {place:,})")
        found[number] = (content.tell(), length)
        count += 1
        if count > _MAX_FIELDS:
            raise _Damaged("is not an ONNX model: it has too many parts")
        if number == 0 or content.tell() + length > end:
            raise _Damaged(f"is not a complete ONNX model (byte {place:,} of {end:,})")
        content.seek(length, os.SEEK_CUR)
    return found


def _varint(content: IO[bytes]) -> int:
    """Return the next integer; seven bits per byte, the lowest first."""
    value = 0
    for shift in range(0, 70, 7):
        byte = content.read(1)
        if not byte:
            raise _Damaged("is cut off")
        value |= (byte[0] & 0x7F) << shift
        if byte[0] < 0x80:
            return value
    raise _Damaged(f"is not an ONNX model (byte {content.tell():,})")
