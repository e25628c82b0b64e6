"""Read the weights of an ONNX file, for modules that compute a network themselves.

Our own, because the `onnx` package is needed by tests only. Follows onnx.proto: a model has a graph, a graph has nodes
and tensors.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import ModelFileError
from ...core.files import read_bytes

__all__ = ["read_onnx_weights"]

_MAX_BYTES = 1 << 28
_VARINT, _EIGHT_BYTES, _LENGTH_AND_BYTES, _FOUR_BYTES = 0, 1, 2, 5  # wire types of Protocol Buffers
# Fields of the messages in onnx.proto.
_MODEL_GRAPH = 7
_GRAPH_NODE, _GRAPH_TENSOR = 1, 5
_NODE_INPUT, _NODE_OUTPUT, _NODE_NAME, _NODE_ATTRIBUTE = 1, 2, 3, 5
_ATTRIBUTE_TENSOR = 5
_TENSOR_DIMENSION, _TENSOR_TYPE, _TENSOR_NAME, _TENSOR_BYTES = 1, 2, 8, 9
_FLOAT32 = 1

Message = memoryview


def read_onnx_weights(path: Path) -> dict[str, NDArray[np.float32]]:
    """Return the float32 tensors of an ONNX file.

    Parameters
    ----------
    path : Path
        A file of at most 268 MB.

    Returns
    -------
    dict of str to float32 array
        By their names, those of constant nodes by the names of their outputs, and all again by ``NODE:i`` for input i
        of each node that uses them: exporters give new names to tensors that they transpose. The arrays are read-only.

    Raises
    ------
    ModelFileError
        When the file is not a complete ONNX model.
    FormatError
        When it cannot be read.
    """
    data = read_bytes(path, max_bytes=_MAX_BYTES, advice="Run: python -m engine models fetch")
    weights: dict[str, NDArray[np.float32]] = {}
    try:
        for graph in _messages(memoryview(data), _MODEL_GRAPH):
            for tensor in _messages(graph, _GRAPH_TENSOR):
                weights.update(_float_tensor(tensor))
            for node in _messages(graph, _GRAPH_NODE):
                weights.update(_constant(node))
                weights.update(_by_input(node, weights))
    except ValueError as error:
        raise ModelFileError(f"{path} is not a complete ONNX model ({error}). Fetch it again.") from error
    return weights


def _float_tensor(tensor: Message) -> dict[str, NDArray[np.float32]]:
    """Return the tensor by its name; nothing for another type, or if its values are not stored as bytes."""
    shape: list[int] = []
    name, kind, content = "", 0, None
    for number, value in _fields(tensor):
        if number == _TENSOR_DIMENSION and isinstance(value, int):
            shape.append(value)
        elif number == _TENSOR_DIMENSION and not isinstance(value, int):
            shape += _integers(value)
        elif number == _TENSOR_TYPE and isinstance(value, int):
            kind = value
        elif number == _TENSOR_NAME and not isinstance(value, int):
            name = bytes(value).decode("utf-8")
        elif number == _TENSOR_BYTES and not isinstance(value, int):
            content = value
    if kind != _FLOAT32 or content is None:
        return {}
    if 4 * math.prod(shape) != len(content):
        raise ValueError(f"{len(content)} bytes do not fit the shape {shape} of a tensor")
    return {name: np.frombuffer(content, "<f4").reshape(shape)}


def _constant(node: Message) -> dict[str, NDArray[np.float32]]:
    """Return the tensors among the attributes of a node by the names of its outputs."""
    outputs = [bytes(value).decode("utf-8") for value in _messages(node, _NODE_OUTPUT)]
    tensors = [_float_tensor(tensor) for attribute in _messages(node, _NODE_ATTRIBUTE)
               for tensor in _messages(attribute, _ATTRIBUTE_TENSOR)]  # fmt: skip
    return {output: array for output, named in zip(outputs, tensors, strict=False) for array in named.values()}


def _by_input(node: Message, weights: dict[str, NDArray[np.float32]]) -> dict[str, NDArray[np.float32]]:
    texts = [(number, bytes(value).decode("utf-8")) for number, value in _fields(node)
             if number in (_NODE_INPUT, _NODE_NAME) and not isinstance(value, int)]  # fmt: skip
    name = next((text for number, text in texts if number == _NODE_NAME), "")
    inputs = [text for number, text in texts if number == _NODE_INPUT]
    return {f"{name}:{index}": weights[text] for index, text in enumerate(inputs) if text in weights}


def _messages(message: Message, number: int) -> Iterator[Message]:
    return (value for found, value in _fields(message) if found == number and not isinstance(value, int))


def _fields(message: Message) -> Iterator[tuple[int, Message | int]]:
    """Return number and value of each field of a message: an integer, or the bytes of any other value."""
    place = 0
    while place < len(message):
        tag, place = _varint(message, place)
        wire_type = tag & 7
        if wire_type == _VARINT:
            value, place = _varint(message, place)
            yield tag >> 3, value
            continue
        if wire_type == _LENGTH_AND_BYTES:
            length, place = _varint(message, place)
        elif wire_type in (_EIGHT_BYTES, _FOUR_BYTES):
            length = 8 if wire_type == _EIGHT_BYTES else 4
        else:
            raise ValueError(f"unknown wire type {wire_type}")
        if place + length > len(message):
            raise ValueError("a part is cut off")
        yield tag >> 3, message[place : place + length]
        place += length


def _integers(packed: Message) -> list[int]:
    values, place = [], 0
    while place < len(packed):
        value, place = _varint(packed, place)
        values.append(value)
    return values


def _varint(message: Message, place: int) -> tuple[int, int]:
    """Return the integer at a place, seven bits per byte, the lowest first, and the place behind it."""
    value = 0
    for shift in range(0, 70, 7):
        if place >= len(message):
            raise ValueError("a number is cut off")
        byte = message[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, place
    raise ValueError("a number has more than ten bytes")
