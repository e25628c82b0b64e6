"""Weights are read from ONNX files, and damaged files are refused with a readable error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from engine.core.errors import HeritageError, ModelFileError
from engine.install.models import read_onnx_weights

WEIGHT = np.arange(6, dtype=np.float32).reshape(2, 3)
CONSTANT = np.array([0.5, 1.5, 2.5], np.float32)


def _model() -> bytes:
    constant = helper.make_node("Constant", [], ["c"], name="/layer/Constant", value=numpy_helper.from_array(CONSTANT))
    products = helper.make_node("MatMul", ["x", "w"], ["xw"], name="/layer/MatMul")
    node = helper.make_node("Add", ["xw", "c"], ["y"], name="/layer/Add")
    graph = helper.make_graph(
        [constant, products, node],
        "graph",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 2])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 3])],
        [
            numpy_helper.from_array(WEIGHT, "w"),
            numpy_helper.from_array(np.array([7]), "shape"),
            numpy_helper.from_array(np.float32(3), "scalar"),
        ],
    )
    return bytes(helper.make_model(graph).SerializeToString())


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "model.onnx"
    path.write_bytes(_model())
    onnx.checker.check_model(str(path))
    return path


def test_weights_are_found_by_name_and_by_the_node_that_uses_them(file: Path) -> None:
    weights = read_onnx_weights(file)
    assert set(weights) == {"w", "scalar", "/layer/MatMul:1", "c", "/layer/Add:1"}
    np.testing.assert_array_equal(weights["w"], WEIGHT)
    np.testing.assert_array_equal(weights["/layer/Add:1"], CONSTANT)
    np.testing.assert_array_equal(weights["/layer/MatMul:1"], WEIGHT)
    assert weights["scalar"].shape == () and weights["w"].dtype == np.float32


@pytest.mark.parametrize(
    "content", [_model()[:-3], b"<html>", _model().replace(b"\x08\x02\x08\x03", b"\x08\x02\x08\x04")]
)
def test_damaged_file_is_refused(file: Path, content: bytes) -> None:
    file.write_bytes(content)
    with pytest.raises(ModelFileError, match="is not a complete ONNX model"):
        read_onnx_weights(file)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 10**6), st.integers(0, 255))
def test_any_changed_byte_gives_weights_or_a_readable_error(file: Path, place: int, value: int) -> None:
    content = bytearray(_model())
    content[place % len(content)] = value
    file.write_bytes(content)
    try:
        read_onnx_weights(file)
    except HeritageError as error:
        assert "Fetch it again" in str(error)
