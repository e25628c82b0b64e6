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
from .protobuf import Field, NotProtobuf, fields

_MAX_JSON_BYTES = 16 << 20
_MAX_FIELDS = 1 << 17  # a model has some thousands; more of them would only take time
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
    try:
        model = _fields(content, 0, content.seek(0, os.SEEK_END))
        if not {_IR_VERSION, _GRAPH, _OPSET_IMPORT} <= model.keys():
            raise _Damaged("is not an ONNX model; it may be cut off or a web page")
        graph = model[_GRAPH]
        if not {_NODE, _OUTPUT} <= _fields(content, graph.start, graph.start + graph.length).keys():
            raise _Damaged("is an ONNX model without nodes or without outputs")
    except NotProtobuf as error:
        raise _Damaged(f"is not {'a complete' if error.is_cut else 'an'} ONNX model ({error})") from error


def _fields(content: IO[bytes], start: int, end: int) -> dict[int, Field]:
    """Return the last field of each number in the message between two places of the file."""
    found: dict[int, Field] = {}
    for count, field in enumerate(fields(content, start, end)):
        if count == _MAX_FIELDS:
            raise _Damaged("is not an ONNX model: it has too many parts")
        found[field.number] = field
    return found
