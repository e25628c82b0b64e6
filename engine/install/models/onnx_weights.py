"""Read the weights of an ONNX file, for modules that compute a network themselves.

Our own, because the `onnx` package is needed by tests only. Follows onnx.proto: a model has a graph, a graph has nodes
and tensors.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import ModelFileError
from ...core.files import read_bytes
from .protobuf import Field, fields, varint

_MAX_BYTES = 1 << 28
# Fields of the messages in onnx.proto.
_MODEL_GRAPH = 7
_GRAPH_NODE, _GRAPH_TENSOR = 1, 5
_NODE_INPUT, _NODE_OUTPUT, _NODE_NAME, _NODE_ATTRIBUTE = 1, 2, 3, 5
_ATTRIBUTE_TENSOR = 5
_TENSOR_DIMENSION, _TENSOR_TYPE, _TENSOR_NAME, _TENSOR_BYTES = 1, 2, 8, 9
_FLOAT32 = 1


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
    file = _File(read_bytes(path, max_bytes=_MAX_BYTES, advice="Run: python -m engine models fetch"))
    weights: dict[str, NDArray[np.float32]] = {}
    try:
        for graph in file.messages(file.whole, _MODEL_GRAPH):
            for tensor in file.messages(graph, _GRAPH_TENSOR):
                weights.update(_float_tensor(file, tensor))
            for node in file.messages(graph, _GRAPH_NODE):
                weights.update(_constant(file, node))
                weights.update(_by_input(file, node, weights))
    except ValueError as error:
        raise ModelFileError(f"{path} is not a complete ONNX model ({error}). Fetch it again.") from error
    return weights


class _File:
    """The messages of a file, each the field that holds it."""

    def __init__(self, data: bytes) -> None:
        self._data, self._stream = memoryview(data), io.BytesIO(data)
        self.whole = Field(0, None, 0, len(data))

    def fields(self, message: Field) -> Iterator[Field]:
        return fields(self._stream, message.start, message.start + message.length)

    def messages(self, message: Field, number: int) -> Iterator[Field]:
        return (field for field in self.fields(message) if field.number == number and field.integer is None)

    def content(self, field: Field) -> memoryview:
        return self._data[field.start : field.start + field.length]

    def text(self, field: Field) -> str:
        return bytes(self.content(field)).decode("utf-8")

    def integers(self, field: Field) -> list[int]:
        """Return one integer, or several that are packed as bytes."""
        if field.integer is not None:
            return [field.integer]
        packed, values = io.BytesIO(self.content(field)), []
        while packed.tell() < field.length:
            values.append(varint(packed))
        return values


def _float_tensor(file: _File, tensor: Field) -> dict[str, NDArray[np.float32]]:
    """Return the tensor by its name; nothing for another type, or if its values are not stored as bytes."""
    shape: list[int] = []
    name, kind, content = "", 0, None
    for field in file.fields(tensor):
        if field.number == _TENSOR_DIMENSION:
            shape += file.integers(field)
        elif field.number == _TENSOR_TYPE and field.integer is not None:
            kind = field.integer
        elif field.number == _TENSOR_NAME and field.integer is None:
            name = file.text(field)
        elif field.number == _TENSOR_BYTES and field.integer is None:
            content = file.content(field)
    if kind != _FLOAT32 or content is None:
        return {}
    if 4 * math.prod(shape) != len(content):
        raise ValueError(f"{len(content)} bytes do not fit the shape {shape} of a tensor")
    return {name: np.frombuffer(content, "<f4").reshape(shape)}


def _constant(file: _File, node: Field) -> dict[str, NDArray[np.float32]]:
    """Return the tensors among the attributes of a node by the names of its outputs."""
    outputs = [file.text(output) for output in file.messages(node, _NODE_OUTPUT)]
    tensors = [_float_tensor(file, tensor) for attribute in file.messages(node, _NODE_ATTRIBUTE)
               for tensor in file.messages(attribute, _ATTRIBUTE_TENSOR)]  # fmt: skip
    return {output: array for output, named in zip(outputs, tensors, strict=False) for array in named.values()}


def _by_input(file: _File, node: Field, weights: dict[str, NDArray[np.float32]]) -> dict[str, NDArray[np.float32]]:
    name = next((file.text(field) for field in file.messages(node, _NODE_NAME)), "")
    inputs = [file.text(field) for field in file.messages(node, _NODE_INPUT)]
    return {f"{name}:{index}": weights[text] for index, text in enumerate(inputs) if text in weights}
