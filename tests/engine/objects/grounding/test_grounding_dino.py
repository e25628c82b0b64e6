"""Grounding DINO compared with transformers: tokens, pixels and boxes, with random weights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import transformers

from engine.core.errors import ModelFileError, PromptError
from engine.install.models.onnx_session import open_session
from engine.objects.grounding.detector import Detector
from engine.objects.grounding.dino_inputs import Tokenizer, normalise_picture, resized_size, to_caption
from engine.objects.grounding.grounding_dino import GroundingDino, GroundingSettings, best_segments
from tests.engine.objects.grounding import tiny_dino

KEEP_ALL = GroundingSettings(box_threshold=1e-6, text_threshold=0.5, max_overlap=1.0)


@dataclass(frozen=True)
class Tiny:
    """The same weights in transformers and, exported to ONNX, in the engine's detector."""

    model: Any
    processor: Any
    detector: GroundingDino
    tokenizer_file: Path


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Tiny:
    folder = tmp_path_factory.mktemp("dino")
    tokenizer = tiny_dino.tokenizer(folder)
    model = tiny_dino.model()
    (folder / "tiny.onnx").write_bytes(tiny_dino.exported())
    side = {"height": tiny_dino.SIDE, "width": tiny_dino.SIDE}
    processor = transformers.GroundingDinoProcessor(
        transformers.GroundingDinoImageProcessorPil(size=side, do_pad=False), tokenizer
    )
    session = open_session(folder / "tiny.onnx")
    detector = GroundingDino("tiny", session, folder / "tokenizer.json", KEEP_ALL)
    return Tiny(model, processor, detector, folder / "tokenizer.json")


def _photo(height: int = 70, width: int = 130, seed: int = 0) -> np.ndarray:
    small = np.random.default_rng(seed).integers(0, 256, (7, 9, 3), np.uint8)
    return np.asarray(small.repeat(height // 7 + 1, axis=0).repeat(width // 9 + 1, axis=1)[:height, :width])


@pytest.mark.parametrize(
    "text",
    ["a red vase .", "the Head of a woman .", "an 18th-century vase's café .", "vasen ??? , . unheard .", "VASE."],
)
def test_tokens_equal_transformers(tiny: Tiny, text: str) -> None:
    ours = Tokenizer(tiny.tokenizer_file)(text, None)
    theirs = tiny.processor.tokenizer(text, return_tensors="np")
    np.testing.assert_array_equal(ours.ids, theirs["input_ids"])
    np.testing.assert_array_equal(ours.attention, theirs["attention_mask"])
    padded = Tokenizer(tiny.tokenizer_file)(text, 32)
    assert padded.ids.shape == (1, 32) and padded.attention.sum() == ours.ids.shape[1]


@pytest.mark.parametrize(("height", "width"), [(70, 130), (130, 70), (64, 64), (64, 90), (60, 301), (501, 97)])
def test_pixels_equal_transformers(height: int, width: int) -> None:
    pixels = _photo(height, width)
    shortest = transformers.GroundingDinoImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 100})
    theirs = shortest(pixels, return_tensors="np")["pixel_values"]
    ours = normalise_picture(pixels, resized_size(height, width, 64, 100))
    assert ours.shape == theirs.shape
    np.testing.assert_allclose(ours, theirs, atol=1e-5)  # float32 in another order


@pytest.mark.parametrize("prompt", ["a red vase", "head of a woman.", "Statue"])
@pytest.mark.parametrize("size", [(70, 130), (200, 90)])
def test_boxes_scores_and_labels_equal_transformers(tiny: Tiny, prompt: str, size: tuple[int, int]) -> None:
    """The detector runs the ONNX export, padded to 32 tokens; transformers runs the torch model without padding."""
    pixels = _photo(*size)
    given = tiny.processor(images=pixels, text=to_caption(prompt), return_tensors="pt")
    with torch.no_grad():
        outputs = tiny.model(**given)
    (theirs,) = tiny.processor.post_process_grounded_object_detection(
        outputs, given["input_ids"], threshold=0.0, text_threshold=0.5, target_sizes=[size]
    )
    ours = tiny.detector.predict_boxes(pixels, prompt)
    assert len(ours.scores) == 40 and np.ptp(ours.scores) > 0.01  # random weights, but different scores
    np.testing.assert_allclose(ours.scores, theirs["scores"].numpy(), atol=2e-5)  # seen: 9e-7
    np.testing.assert_allclose(ours.corners, theirs["boxes"].numpy(), atol=1e-3)  # pixels; seen: 3e-5
    labels = [label.replace("[SEP]", "").replace(" .", "").strip(" .") for label in theirs["text_labels"]]
    assert list(ours.labels) == labels and any(labels)


def test_detections_are_sorted_inside_the_photo_and_above_the_threshold(tiny: Tiny) -> None:
    pixels = _photo()
    every = tiny.detector.detect(pixels, "a red vase")
    scores = [detection.score for detection in every]
    assert len(every) == 40 and scores == sorted(scores, reverse=True)
    boxes = np.array([detection.box for detection in every])
    assert boxes.min() >= 0 and (boxes[:, [0, 2]] <= 130).all() and (boxes[:, [1, 3]] <= 70).all()
    settings = GroundingSettings(box_threshold=float(np.median(scores)), text_threshold=0.5, max_overlap=1.0)
    few = GroundingDino("tiny", tiny.detector._session, tiny.tokenizer_file, settings)
    assert few.detect(pixels, "a red vase") == every[:20]


class _Scripted:
    """A session with free input sizes that returns fixed boxes (fractions of the photo) and records its inputs."""

    def __init__(self, boxes: list[tuple[float, float, float, float]], scores: list[float]) -> None:
        self.boxes, self.scores = np.array([boxes], np.float32), scores
        self.inputs: list[dict[str, np.ndarray]] = []

    def get_inputs(self) -> list[SimpleNamespace]:
        shapes = {"pixel_values": ["b", 3, "h", "w"], "input_ids": ["b", "l"], "attention_mask": ["b", "l"]}
        return [SimpleNamespace(name=name, shape=shape) for name, shape in shapes.items()]

    def get_outputs(self) -> list[SimpleNamespace]:
        return [SimpleNamespace(name="logits"), SimpleNamespace(name="pred_boxes")]

    def run(self, names: list[str], inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        self.inputs.append(inputs)
        logits = np.full((1, len(self.scores), 256), -np.inf, np.float32)
        logits[0, :, 1] = np.log(np.array(self.scores) / (1 - np.array(self.scores)))
        return [logits, self.boxes]


def test_export_with_free_sizes_gets_a_shorter_side_of_800_and_no_padding(tiny: Tiny) -> None:
    session = _Scripted([(0.5, 0.5, 0.5, 0.5)], [0.6])
    detector = GroundingDino("free", session, tiny.tokenizer_file)
    (found,) = detector.detect(_photo(100, 150), "vase")
    assert session.inputs[0]["pixel_values"].shape == (1, 3, 800, 1200)
    assert session.inputs[0]["input_ids"].shape == (1, 4) and "pixel_mask" not in session.inputs[0]
    assert found.box == pytest.approx((37.5, 25, 112.5, 75)) and found.label == "vase"
    assert found.score == pytest.approx(0.6, abs=1e-6)


def test_overlapping_boxes_are_suppressed_and_the_model_runs_once_per_photo(tiny: Tiny) -> None:
    session = _Scripted([(0.5, 0.5, 0.4, 0.4), (0.51, 0.5, 0.4, 0.4), (0.2, 0.2, 0.2, 0.2)], [0.5, 0.6, 0.4])
    detector = GroundingDino("free", session, tiny.tokenizer_file)
    for _ in range(2):
        assert [round(found.score, 3) for found in detector.detect(_photo(), "vase")] == [0.6, 0.4]
    assert len(session.inputs) == 1


def test_segment_that_fits_the_box_is_selected_not_the_wall_behind_it(tiny: Tiny) -> None:
    labels = np.ones((100, 200), np.int32)  # 1: the wall
    labels[20:80, 40:100] = 2  # the vase
    labels[20:40, 60:80] = 3  # its neck
    labels[5:15, 150:190] = 0
    vase = (0.35, 0.5, 0.3, 0.6)
    session = _Scripted([vase, (0.352, 0.49, 0.29, 0.6), (0.85, 0.1, 0.2, 0.1), (0.5, 0.5, 1, 1)], [0.7, 0.8, 0.6, 0.1])
    detector = GroundingDino("free", session, tiny.tokenizer_file, GroundingSettings(max_overlap=1.0))
    (found,) = detector.detect(_photo(100, 200), "vase", labels=labels)  # no segment fits the third box
    assert (found.region, found.box) == (2, (40.0, 20.0, 100.0, 80.0)) and found.score == pytest.approx(0.8, abs=1e-6)
    half = labels[::2, ::2].copy()  # a label map may be smaller than the photo
    assert [found.region for found in detector.detect(_photo(100, 200), "vase", labels=half)] == [2]
    assert best_segments(np.array([[0, 0, 200, 100]], np.float32), labels)[0][0] == 1


def test_photo_that_is_asked_again_is_not_processed_again_and_no_crop_is_described(tiny: Tiny) -> None:
    session = _Scripted([(0.5, 0.5, 0.7, 0.7)], [0.4])
    detector = GroundingDino("free", session, tiny.tokenizer_file)
    assert detector.detect(_photo(), "vase") == detector.detect(_photo(), "vase")
    assert len(session.inputs) == 1
    assert detector.describe_crops(_photo(), [[0, 0, 9, 9]], [np.ones((9, 9), bool)]) is None


def test_any_words_are_accepted_but_not_an_empty_prompt(tiny: Tiny) -> None:
    detector: Detector = tiny.detector
    assert detector.check_prompt("an amphora with handles").known
    for empty in ("", "  ", " . ?"):
        with pytest.raises(PromptError, match="empty"):
            detector.check_prompt(empty)
    with pytest.raises(PromptError, match="Use fewer words"):
        detector.detect(_photo(), "vase " * 40)


def test_caption_is_one_phrase_in_lower_case_with_a_period() -> None:
    assert to_caption(" Red  Vase. ") == "red vase ."
    assert to_caption("vase. statue?") == "vase statue ."  # exports with one phrase would process two phrases wrongly


def test_other_models_and_broken_tokenizers_give_readable_errors(tiny: Tiny, tmp_path: Path) -> None:
    session = _Scripted([], [])
    session.get_outputs = lambda: [SimpleNamespace(name="logits")]  # type: ignore[method-assign]
    with pytest.raises(ModelFileError, match="not a Grounding DINO export"):
        GroundingDino("other", session, tiny.tokenizer_file)
    (tmp_path / "tokenizer.json").write_text("{}")
    with pytest.raises(ModelFileError, match="tokenizer file .* cannot be read"):
        GroundingDino("other", _Scripted([], []), tmp_path / "tokenizer.json")
