"""A crop that looks like the pictures of a word gets that word, and all classes and words compete for it."""

from __future__ import annotations

import numpy as np
import pytest

from engine.core.errors import PromptError
from engine.core.words import picture_words
from engine.masks import mask_box
from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from engine.objects.grounding.pictures import FEATURES_FILE, picture_logits
from engine.objects.grounding.wholeness import usual_features
from tests.engine.objects.grounding.conftest import Room


def _number(word: str) -> int:
    return next(iter(picture_words().classes_of_word[word]))


def _features_like(word: str) -> np.ndarray:
    """Return features that lie in the direction of a word's pictures from those of usual things, [1, 2560]."""
    stored = np.load(FEATURES_FILE)[_number(word)].astype(np.float32)
    return np.maximum(usual_features() + 4 * stored / np.linalg.norm(stored), 0)[None] ** 2


@pytest.mark.parametrize("word", ["key", "skull", "gravestone", "suitcase", "coin"])
def test_features_in_the_direction_of_its_pictures_are_most_like_a_word(word: str) -> None:
    logits = picture_logits(_features_like(word).reshape(1, 2, -1))
    assert logits.shape == (1, 2, len(picture_words().classes))
    assert (logits.argmax(axis=2) == _number(word)).all()


def test_word_of_pictures_is_scored_beside_all_classes_and_nothing_is_found_by_it(
    detector: OfflineVocabulary, room: Room
) -> None:
    masks = [room.labels == room.ids[name] for name in ("drum", "teapot", "hourglass")]
    shown = detector.describe_crops(room.pixels, [mask_box(mask) for mask in masks], masks)
    described = np.concatenate([shown, _features_like("skull")])
    scores = np.array(detector.score_unknown(described, "der Schädel"))
    assert scores.argmax() == 3 and scores[3] > 0.5 and scores[:3].max() < 0.2
    with pytest.raises(PromptError, match="known from pictures"):
        detector.score_descriptions(described, "der Schädel")
    assert detector.score_unknown(described, "vase") is None  # a class
    assert detector.score_unknown(described, "sarcophagus") is None


@pytest.mark.parametrize("text", ["eggs", "a pencil", "feather", "deer", "gift", "une pomme de pin", "lampe de poche"])
def test_word_of_pictures_is_not_searched_for_as_a_class_of_nearly_the_same_meaning(
    detector: OfflineVocabulary, text: str
) -> None:
    check = detector.check_prompt(text)
    assert not check.known and check.matches == []
    assert check.message.endswith("but known from pictures. Click on the object instead.")


@pytest.mark.parametrize("text", ["cake stand", "key ring", "tree stump", "book stand", "olive oil"])
def test_compound_with_a_word_of_pictures_is_not_known_from_them(detector: OfflineVocabulary, text: str) -> None:
    assert "known from pictures" not in detector.check_prompt(text).message
    assert detector.score_unknown(_features_like("key"), text) is None


def test_word_of_pictures_has_no_scores_where_nothing_was_described(detector: OfflineVocabulary) -> None:
    assert detector.score_unknown(np.zeros((0, 1), np.float32), "key") is None
