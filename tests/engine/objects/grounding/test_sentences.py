"""Texts of similar meaning have similar embeddings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import ModelFileError
from engine.objects.grounding.sentences import SentenceEncoder
from tests.engine.install.models.weights import fetched


def test_vectors_have_unit_length_for_any_text(encoder: SentenceEncoder) -> None:
    vectors = encoder.encode(["vase", "", "花瓶", "word " * 500])
    assert vectors.shape == (4, 384) and vectors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    assert encoder.encode([]).shape == (0, 384)


def test_related_words_are_more_similar_than_unrelated_ones(encoder: SentenceEncoder) -> None:
    vase, vases, teapot, kettle, wolf = encoder.encode(["vase", "vases", "teapot", "kettle", "wolf"])
    assert vase @ vases > 0.9
    assert teapot @ kettle > 0.5 > teapot @ wolf


def test_padding_for_a_longer_text_changes_little(encoder: SentenceEncoder) -> None:
    alone = encoder.encode(["hourglass"])[0]
    padded = encoder.encode(["hourglass", "a sandglass that runs for sixty minutes and stands on the shelf"])[0]
    assert alone @ padded > 0.97  # the int8 model scales its values per batch; seen: 0.99


def test_broken_tokenizer_file_gives_a_readable_error(tmp_path: Path) -> None:
    (tmp_path / "tokenizer.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ModelFileError, match="tokenizer file .* cannot be read"):
        SentenceEncoder(fetched("minilm")[0], tmp_path / "tokenizer.json")
