"""The detector for any words, with an encoder of random weights and the real offline vocabulary."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import PromptError
from engine.core.words import MADE_CLASSES, word_list
from engine.install.models import open_session
from engine.masks import mask_box
from engine.objects.grounding.any_word import AnyWord
from engine.objects.grounding.crops import cut_out
from engine.objects.grounding.detector import Detector
from engine.objects.grounding.image_text import ENCODERS, ImageTextEncoder
from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from tests.engine.objects.grounding import tiny_encoders
from tests.engine.objects.grounding.conftest import Room

WIDTH = 24


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("any_word")


@pytest.fixture(scope="module")
def encoder(folder: Path) -> ImageTextEncoder:
    tokenizer = tiny_encoders.clip_tokenizer(folder)
    vision, text = tiny_encoders.export("clip", tiny_encoders.clip(len(tokenizer)), folder)
    sessions = open_session(vision), open_session(text)
    return ImageTextEncoder("clip-vit-b-32", ENCODERS["clip-vit-b-32"], *sessions, folder / "tokenizer.json")


@pytest.fixture(scope="module")
def any_word(encoder: ImageTextEncoder, detector: OfflineVocabulary, folder: Path) -> AnyWord:
    return AnyWord(encoder, detector, folder / "derived")


def _words() -> list[str]:
    return list(dict.fromkeys(entry.words[0] for entry in word_list().classes))


def test_any_words_are_known_but_not_an_empty_prompt(any_word: AnyWord) -> None:
    detector: Detector = any_word
    assert detector.check_prompt("Krug aus Zinn").known and detector.check_prompt("an xylograph").known
    for empty in ("", "  ", "!?"):
        with pytest.raises(PromptError, match="prompt is empty"):
            detector.check_prompt(empty)


def test_crop_is_described_on_white_and_before_a_blurred_surrounding_and_by_how_whole_it_looks(
    any_word: AnyWord, encoder: ImageTextEncoder, detector: OfflineVocabulary, room: Room
) -> None:
    masks = [room.labels == room.ids[name] for name in ("vase", "teapot")]
    boxes = [mask_box(mask) for mask in masks]
    described = any_word.describe_crops(room.pixels, boxes, masks)
    assert described.shape == (2, 2 * WIDTH + 1) and described.dtype == np.float32
    whole = detector.whole_odds(detector.describe_crops(room.pixels, boxes, masks))
    np.testing.assert_allclose(any_word.whole_odds(described), whole, atol=1e-5)
    for number, background in enumerate(("white", "blurred")):
        crop = cut_out(room.pixels, boxes[1], masks[1], background).squared()
        own = described[1, number * WIDTH : (number + 1) * WIDTH]
        np.testing.assert_allclose(own, encoder.of_pictures([crop])[0], atol=1e-5)


def test_segments_that_are_nearly_the_whole_photo_or_a_speck_are_found_by_no_detector(
    any_word: AnyWord, detector: OfflineVocabulary, room: Room
) -> None:
    labels = np.full(room.labels.shape, 1, np.int32)
    labels[room.labels == room.ids["vase"]] = 2
    labels[:2, :2] = 3
    for one in (any_word, detector):
        assert {found.region for found in one.detect(room.pixels, "vase", labels=labels)} == {2}


def test_example_is_like_what_it_shows_and_needs_no_words(any_word: AnyWord) -> None:
    described = np.hstack([_unit(5, seed=8), _unit(5, seed=9), np.zeros((5, 1))]).astype(np.float32)
    means = any_word.example_vectors(described)[:2]
    assert means.shape == (2, 2 * WIDTH)
    scores = any_word.score_examples(described, means)
    assert scores.argmax(axis=0).tolist() == [0, 1] and scores[[0, 1], [0, 1]].min() > 0.9
    assert any_word.fingerprint and any_word.fingerprint != any_word._classifier.fingerprint


def test_crop_keeps_the_object_sharp_in_a_square_and_blurs_what_is_around_it(room: Room) -> None:
    mask = room.labels == room.ids["teapot"]
    x0, y0, x1, y1 = mask_box(mask)
    cut = cut_out(room.pixels, (x0, y0, x1, y1), mask, "blurred")
    square = cut.squared()
    assert square.shape[0] == square.shape[1] >= 1.4 * max(x1 - x0, y1 - y0) - 1
    left, top = int(np.floor(cut.left)), int(np.floor(cut.top))
    shown, outside = square[y0 - top : y1 - top, x0 - left : x1 - left], ~mask[y0:y1, x0:x1]
    np.testing.assert_array_equal(shown[~outside], room.pixels[y0:y1, x0:x1][~outside])
    assert np.abs(np.diff(shown.astype(int), axis=0))[outside[1:]].mean() < 2  # no edges are left
    white = cut_out(room.pixels, (x0, y0, x1, y1), mask, "white").squared()
    assert (white[y0 - top : y1 - top, x0 - left : x1 - left][outside] == 255).all()


def test_crop_that_reaches_beyond_the_photo_is_white_there(room: Room) -> None:
    everything = np.ones(room.labels.shape, bool)
    square = cut_out(room.pixels, (-20.0, -20.0, 30.0, 30.0), everything, "white").squared()
    # With a margin of a fifth on each side, from -30 to 40.
    assert square.shape == (70, 70, 3) and (square[:30] == 255).all() and (square[:, :30] == 255).all()
    np.testing.assert_array_equal(square[30:, 30:], room.pixels[:40, :40])


def test_score_is_the_probability_among_the_words_that_do_not_mean_nearly_the_same(
    any_word: AnyWord, encoder: ImageTextEncoder
) -> None:
    words = _words()
    known, asked = encoder.of_words(words), encoder.of_words(["amphora"])[0]
    described = np.hstack([_unit(3, seed=1), _unit(3, seed=2), np.zeros((3, 1))]).astype(np.float32)
    unlike = np.argsort(-(known @ asked), kind="stable")[5:]
    expected = []
    for row in described:
        each = []
        for vector in (row[:WIDTH], row[WIDTH : 2 * WIDTH]):
            logits = 100 * np.append(known[unlike] @ vector, asked @ vector).astype(np.float64)
            each.append(np.exp(logits[-1] - logits.max()) / np.exp(logits - logits.max()).sum())
        expected.append(np.mean(each))
    np.testing.assert_allclose(any_word.score_descriptions(described, "Amphora"), expected, atol=1e-5)


def test_scores_of_the_vocabulary_are_those_of_its_words(any_word: AnyWord) -> None:
    described = np.hstack([_unit(4, seed=3), _unit(4, seed=4), np.zeros((4, 1))]).astype(np.float32)
    all_words = any_word.score_vocabulary(described)
    made = [word_list().classes[index].words[0] for index in MADE_CLASSES]
    made = [word for word in _words() if word in made]
    assert all_words.shape == (4, len(made)) and {"abacus", "vase", "yurt"} <= set(made) and "puffer" not in made
    for word in ("vase", "teapot", "acoustic guitar"):
        own = all_words[:, made.index(word)]
        np.testing.assert_allclose(any_word.score_descriptions(described, word), own, atol=1e-5)


def test_german_word_is_asked_in_english_of_an_encoder_that_knows_no_other_language(
    any_word: AnyWord, encoder: ImageTextEncoder
) -> None:
    described = np.hstack([_unit(4, seed=7), _unit(4, seed=8), np.zeros((4, 1))]).astype(np.float32)
    np.testing.assert_array_equal(
        any_word.score_descriptions(described, "Teekanne"), any_word.score_descriptions(described, "teapot")
    )
    asked: list[list[str]] = []

    class Listening(ImageTextEncoder):
        def of_words(self, words):  # type: ignore[no-untyped-def]
            asked.append(list(words))
            return encoder.of_words(words)

    listening = Listening.__new__(Listening)
    listening.__dict__.update(encoder.__dict__)
    listening.kind = replace(encoder.kind, knows_languages=True)
    AnyWord(listening, any_word._classifier, None).score_descriptions(described, "Teekanne")
    assert asked[0] == ["teekanne"]


def test_object_that_looks_like_a_word_is_named_by_it_and_scores_highest_for_it(
    any_word: AnyWord, encoder: ImageTextEncoder
) -> None:
    vase, teapot = encoder.of_words(["vase", "teapot"])
    described = np.array([[*vase, *vase, 0], [*teapot, *teapot, 0]], np.float32).astype(np.float16).astype(np.float32)
    assert any_word.name_descriptions(described[:1])[0][0] == "vase"
    assert np.argmax(any_word.score_descriptions(described, "teapot")) == 1
    assert any_word.name_descriptions(described[:0]) == [] and any_word.score_descriptions(described[:0], "vase") == []


def test_vectors_of_the_vocabulary_are_kept(any_word: AnyWord, encoder: ImageTextEncoder, folder: Path) -> None:
    described = np.hstack([_unit(1, seed=5), _unit(1, seed=6), np.zeros((1, 1))]).astype(np.float32)
    first = any_word.score_vocabulary(described)
    (file,) = (folder / "derived").glob("class-words-*.npy")
    before = file.stat().st_mtime_ns
    again = AnyWord(encoder, any_word._classifier, folder / "derived")
    np.testing.assert_array_equal(again.score_vocabulary(described), first)
    assert file.stat().st_mtime_ns == before


def test_segments_of_a_photo_are_detected(any_word: AnyWord, room: Room) -> None:
    found = any_word.detect(room.pixels, "vase", labels=room.labels)
    assert {room.ids["vase"], room.ids["teapot"]} <= {one.region for one in found}
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)


def _unit(count: int, *, seed: int) -> np.ndarray:
    drawn = np.random.default_rng(seed).normal(size=(count, WIDTH))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1, keepdims=True), np.float32)
