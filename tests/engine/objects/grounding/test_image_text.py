"""Image-text encoders: random weights give the same tokens, pixels, vectors and scores as in `transformers`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
import transformers
from onnxruntime.quantization import quantize_dynamic
from onnxruntime.transformers.float16 import convert_float_to_float16

from engine.core.errors import ModelFileError, PromptError
from engine.install.models import CATALOGUE, find_model_files, open_session
from engine.objects.grounding.image_text import ENCODERS, ImageTextEncoder
from tests.engine.objects.grounding import tiny_encoders

NAMES = {"clip": "clip-vit-b-32", "siglip": "siglip-2-base"}
TEXTS = ["a photo of a Vase.", "the TEAPOT of Zoë's aunt", "pot", "18th-century krug, größer"]


@dataclass(frozen=True)
class Tiny:
    """The same weights in transformers and, exported to ONNX, in the engine's encoder."""

    kind: str
    model: Any
    tokenizer: Any
    encoder: ImageTextEncoder
    folder: Path

    def encoder_of(self, vision: Path, text: Path) -> ImageTextEncoder:
        sessions = open_session(vision), open_session(text)
        return ImageTextEncoder(NAMES[self.kind], ENCODERS[NAMES[self.kind]], *sessions, self.folder / "tokenizer.json")

    def theirs(self, texts: list[str]) -> Any:
        """Return what transformers' processor makes of texts."""
        self.tokenizer.padding_side = "right"
        padding = {"padding": "max_length", "max_length": 64} if self.kind == "siglip" else {"padding": True}
        return self.tokenizer(texts, return_tensors="pt", **padding)["input_ids"]


@pytest.fixture(scope="module", params=["clip", "siglip"])
def tiny(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Tiny:
    kind = request.param
    folder = tmp_path_factory.mktemp(kind)
    tokenizer = getattr(tiny_encoders, f"{kind}_tokenizer")(folder)
    model = getattr(tiny_encoders, kind)(len(tokenizer))
    vision, text = tiny_encoders.export(kind, model, folder)
    sessions = open_session(vision), open_session(text)
    encoder = ImageTextEncoder(NAMES[kind], ENCODERS[NAMES[kind]], *sessions, folder / "tokenizer.json")
    return Tiny(kind, model, tokenizer, encoder, folder)


def _pictures(*sides: int) -> list[np.ndarray]:
    random = np.random.default_rng(3)
    small = [random.integers(0, 256, (7, 7, 3), np.uint8) for _ in sides]
    return [
        np.ascontiguousarray(one.repeat(side // 7 + 1, axis=0).repeat(side // 7 + 1, axis=1)[:side, :side])
        for one, side in zip(small, sides, strict=True)
    ]


def _processor(tiny: Tiny) -> Any:
    if tiny.kind == "clip":
        return transformers.CLIPImageProcessorPil()
    return transformers.SiglipImageProcessorPil(size={"height": 256, "width": 256}, resample=2)


def test_tokens_equal_transformers(tiny: Tiny) -> None:
    np.testing.assert_array_equal(tiny.encoder.tokens_of(TEXTS), tiny.theirs(TEXTS).numpy())


def test_pixels_equal_transformers_for_larger_and_smaller_pictures(tiny: Tiny) -> None:
    pictures = _pictures(600, 224, 97, 301)
    theirs = _processor(tiny)(pictures, return_tensors="np")["pixel_values"]
    ours = np.stack([tiny.encoder.input_of(picture) for picture in pictures])
    assert ours.shape == theirs.shape
    np.testing.assert_allclose(ours, theirs, atol=1e-5)  # float32 in another order


def test_scores_equal_transformers(tiny: Tiny) -> None:
    pictures = _pictures(300, 200, 500, 260, 97, 130, 411, 64, 222, 256)  # more than one batch
    given = torch.from_numpy(_processor(tiny)(pictures, return_tensors="np")["pixel_values"])
    with torch.no_grad():
        out = tiny.model(pixel_values=given, input_ids=tiny.theirs(TEXTS))
    theirs = (out.image_embeds @ out.text_embeds.T).numpy()
    ours = tiny.encoder.of_pictures(pictures) @ tiny.encoder.of_texts(TEXTS).T
    assert ours.shape == (10, 4) and np.ptp(theirs) > 0.1  # random weights, but different scores
    np.testing.assert_allclose(ours, theirs, atol=1e-4 / 100)  # 1e-4 of the scores, which are 100 times the cosine


def test_vector_of_a_word_is_the_mean_over_its_phrasings_whatever_else_is_in_the_batch(tiny: Tiny) -> None:
    encoder = tiny.encoder
    phrased = encoder.of_texts([phrasing.format("vase") for phrasing in encoder.kind.phrasings]).mean(axis=0)
    together = encoder.of_words(["vase", "a teapot that is much longer than the other"])
    # float32 in another order; seen: 3e-7
    np.testing.assert_allclose(together[0], phrased / np.linalg.norm(phrased), atol=1e-5)
    np.testing.assert_allclose(together[0], encoder.of_words(["vase"])[0], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(together, axis=1), 1, atol=1e-6)


def test_text_beyond_the_longest_is_refused(tiny: Tiny) -> None:
    with pytest.raises(PromptError, match="Use fewer words"):
        tiny.encoder.of_words(["xyz " * 40])


@pytest.mark.parametrize("keeps_floats", [True, False], ids=["inputs in 32 bits", "inputs in 16 bits"])
def test_file_with_16_bits_gives_nearly_the_same(tiny: Tiny, tmp_path: Path, keeps_floats: bool) -> None:
    files = [tmp_path / "vision.onnx", tmp_path / "text.onnx"]
    for file in files:
        half = convert_float_to_float16(onnx.load(str(tiny.folder / file.name)), keep_io_types=keeps_floats)
        onnx.save(half, str(file))
    _assert_alike(tiny, tiny.encoder_of(*files), 1e-4)  # 16 bits have three digits; seen: 5e-6


def test_file_with_8_bits_gives_alike_vectors(tiny: Tiny, tmp_path: Path) -> None:
    files = [tmp_path / "vision.onnx", tmp_path / "text.onnx"]
    for file in files:
        # Processors without VNNI add products of 8 bits in 16 bits, which 7 bits of the weights do not exceed.
        quantize_dynamic(str(tiny.folder / file.name), str(file), reduce_range=True)
    # 7 bits have two digits, and errors of all layers add up
    _assert_alike(tiny, tiny.encoder_of(*files), 0.02)


def test_file_with_4_bits_gives_alike_vectors(tiny: Tiny, tmp_path: Path) -> None:
    files = [tmp_path / "vision.onnx", tmp_path / "text.onnx"]
    for file in files:
        assert tiny_encoders.with_four_bits(tiny.folder / file.name, file) >= 8
    _assert_alike(tiny, tiny.encoder_of(*files), 0.2)  # 4 bits have one digit; seen: 0.1


def _assert_alike(tiny: Tiny, other: ImageTextEncoder, tolerance: float) -> None:
    pictures = _pictures(300, 97)
    for ours, exact in (
        (other.of_pictures(pictures), tiny.encoder.of_pictures(pictures)),
        (other.of_texts(TEXTS), tiny.encoder.of_texts(TEXTS)),
    ):
        assert ours.dtype == np.float32
        np.testing.assert_allclose(np.sum(ours * exact, axis=1), 1, atol=tolerance)


def test_wrong_files_are_refused_with_a_sentence(tiny: Tiny, tmp_path: Path) -> None:
    vision, text = tiny.folder / "vision.onnx", tiny.folder / "text.onnx"
    with pytest.raises(ModelFileError, match=r"-vision has the inputs input_ids and needs pixel_values"):
        tiny.encoder_of(text, vision)
    other = onnx.load(str(text))
    other.graph.output[0].name = "last_hidden_state"
    other.graph.node.append(onnx.helper.make_node("Identity", [tiny.encoder.kind.text_output], ["last_hidden_state"]))
    onnx.save(other, str(tmp_path / "other.onnx"))
    with pytest.raises(ModelFileError, match=r"-text has the outputs last_hidden_state and needs"):
        tiny.encoder_of(vision, tmp_path / "other.onnx")
    wide = onnx.load(str(vision))
    wide.graph.input[0].type.tensor_type.shape.dim[2].dim_value = 512
    wide.graph.input[0].type.tensor_type.shape.dim[3].dim_value = 512
    onnx.save(wide, str(tmp_path / "wide.onnx"))
    with pytest.raises(ModelFileError, match=r"takes pictures of 512 pixels instead of"):
        tiny.encoder_of(tmp_path / "wide.onnx", text)
    (tmp_path / "tokenizer.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ModelFileError, match=rf"cannot be read .*models fetch {NAMES[tiny.kind]}"):
        ImageTextEncoder(
            NAMES[tiny.kind], ENCODERS[NAMES[tiny.kind]], open_session(vision), open_session(text),
            tmp_path / "tokenizer.json",
        )  # fmt: skip


def test_halves_of_different_encoders_are_refused(tmp_path: Path, tiny: Tiny) -> None:
    folder = tmp_path / "wider"
    folder.mkdir()
    model = getattr(tiny_encoders, tiny.kind)(len(tiny.tokenizer))
    model.text_projection = torch.nn.Linear(32, 48)
    if tiny.kind == "siglip":
        model.text_model.head = torch.nn.Linear(24, 48)
    _, text = tiny_encoders.export(tiny.kind, model, folder)
    graph = onnx.load(str(text))
    graph.graph.output[0].type.tensor_type.shape.dim[1].dim_value = 48
    onnx.save(graph, str(text))
    with pytest.raises(ModelFileError, match=r"24 numbers and .* 48: they do not belong together"):
        tiny.encoder_of(tiny.folder / "vision.onnx", text)


def test_encoders_of_the_catalogue_have_three_files_each_with_known_hashes() -> None:
    for name in ENCODERS:
        vision, text, tokenizer = find_model_files(name)
        assert vision.file.endswith("vision.onnx") and text.file.endswith("text.onnx")
        assert tokenizer.file.endswith("tokenizer.json")
        assert all(file.sha256 and file.optional and CATALOGUE[file.name] is file for file in (vision, text, tokenizer))
