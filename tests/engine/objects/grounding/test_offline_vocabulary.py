"""The offline vocabulary finds segments for words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import ModelFileError, PromptError
from engine.masks import mask_box
from engine.objects.grounding.detector import Detector
from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from tests.engine.objects.grounding.conftest import Room


@pytest.mark.parametrize("prompt", ["vase", "teapot", "obelisk", "shield", "hourglass", "mask", "goblet"])
def test_exhibit_is_found_first_among_the_segments(detector: Detector, room: Room, prompt: str) -> None:
    found = detector.detect(room.pixels, prompt, labels=room.labels)
    assert found[0].region == room.ids[prompt] and found[0].label == prompt
    assert found[0].score > 0.5  # seen: 0.59 and more
    assert [detection.score for detection in found] == sorted((detection.score for detection in found), reverse=True)
    rows, columns = np.nonzero(room.labels == room.ids[prompt])
    assert found[0].box == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)


def test_label_map_of_another_size_is_resized_to_the_photo(detector: OfflineVocabulary, room: Room) -> None:
    half = np.ascontiguousarray(room.labels[::2, ::2])
    found = detector.detect(room.pixels, "hourglass", labels=half)
    assert found[0].region == room.ids["hourglass"]


def test_descriptions_rank_the_correct_exhibit_first_in_any_order(detector: OfflineVocabulary, room: Room) -> None:
    masks = [room.labels == room.ids[name] for name in ("mask", "hourglass", "teapot")]
    boxes = [mask_box(mask) for mask in masks]
    described = detector.describe_crops(room.pixels, boxes, masks)
    assert described.shape[0] == 3 and described.dtype == np.float32
    scores = detector.score_descriptions(described, "teapots")
    assert int(np.argmax(scores)) == 2 and all(0 <= score <= 1 for score in scores)
    backwards = detector.describe_crops(room.pixels, boxes[::-1], masks[::-1])
    np.testing.assert_allclose(detector.score_descriptions(backwards, "teapots")[::-1], scores, atol=1e-4)
    with pytest.raises(PromptError, match="outside"):
        detector.score_descriptions(described, "sarcophagus")
    with pytest.raises(PromptError, match="nearest words are: teapot"):
        detector.score_descriptions(described, "tepot")
    with pytest.raises(PromptError, match="empty"):
        detector.score_descriptions(described, " ")


def test_example_is_like_what_it_shows_also_where_nothing_else_is_seen(detector: OfflineVocabulary, room: Room) -> None:
    names = ["mask", "teapot", "hourglass"]
    masks = [room.labels == room.ids[name] for name in names]
    described = detector.describe_crops(room.pixels, [mask_box(mask) for mask in masks], masks)
    means = detector.example_vectors(described)
    scores = detector.score_examples(described, means)
    assert scores.shape == (3, 3) and (scores.diagonal() > 0.9).all()
    assert scores[~np.eye(3, dtype=bool)].max() < 0.2
    # Of a scene of one object, all crops are alike, and still like it and nothing else.
    alone = detector.score_examples(np.repeat(described[1:2], 4, axis=0), means)
    assert (alone.argmax(axis=1) == 1).all() and alone[:, 1].min() > 0.9 and alone[:, [0, 2]].max() < 0.5
    assert detector.score_examples(described[:0], means).shape == (0, 3)


def test_clear_exhibit_excludes_other_words_and_not_its_own(detector: OfflineVocabulary, room: Room) -> None:
    mask = room.labels == room.ids["teapot"]
    described = detector.describe_crops(room.pixels, [mask_box(mask)], [mask])
    assert detector.fitting_word(described, "teapot") == ""
    assert detector.fitting_word(described, "accordion") == "teapot"
    flat = np.zeros_like(described)
    assert detector.fitting_word(flat, "accordion") == "", "nothing is probable, so nothing excludes a word"


def test_nothing_is_found_on_a_plain_wall_or_without_segments(detector: OfflineVocabulary) -> None:
    wall = np.full((120, 160, 3), 200, np.uint8)
    assert detector.detect(wall, "teapot", labels=np.ones((120, 160), np.int32)) == []
    assert detector.detect(wall, "teapot", labels=np.zeros((120, 160), np.int32)) == []
    assert detector.detect(wall, "teapot") == [], "without segments nothing is described"


def test_photos_of_one_pixel_and_narrow_photos_raise_no_error(detector: OfflineVocabulary) -> None:
    for shape in ((1, 1, 3), (2, 300, 3)):
        described = detector.describe_crops(np.full(shape, 90, np.uint8), [[0, 0, 1, 1]], [np.ones(shape[:2], bool)])
        (score,) = detector.score_descriptions(described, "vase")
        assert 0 <= score <= 1


def test_error_of_missing_weights_contains_the_command(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="python -m engine models fetch minilm"):
        OfflineVocabulary(tmp_path)


@pytest.mark.parametrize("exhibit", ["teapot", "obelisk", "hourglass"])
def test_object_found_without_a_prompt_gets_its_name(detector: OfflineVocabulary, room: Room, exhibit: str) -> None:
    mask = room.labels == room.ids[exhibit]
    rows, columns = np.nonzero(mask)
    box = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    described = detector.describe_crops(room.pixels, [box], [mask])
    names = detector.name_descriptions(described)
    assert names[0][0] == exhibit and names[0][1] > 0.6
    assert [score for _, score in names] == sorted((score for _, score in names), reverse=True)
    assert detector.name_descriptions(described[:0]) == []
