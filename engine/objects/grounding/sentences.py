"""Sentence embeddings (all-MiniLM-L6-v2, int8): unit vectors whose dot product is the similarity of two texts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...core.arrays import Float32, normalized
from ...install.models import open_session
from .tokenizer_file import open_tokenizer

_WIDTH = 384
_MAX_TOKENS = 256
_BATCH_SIZE = 64


class SentenceEncoder:
    """all-MiniLM-L6-v2 in onnxruntime: mean over the token vectors, normalised to unit length.

    Parameters
    ----------
    model, tokenizer : Path
        The ONNX file and its ``tokenizer.json``, from `models.locate`.
    threads : int
        Worker threads, 2 by default.

    Raises
    ------
    ModelFileError
        When a file is missing or damaged.
    EnvironmentProblem
        When the package ``tokenizers`` is missing.

    References
    ----------
    Reimers and Gurevych, "Sentence-BERT", 2019, section 3 (mean pooling).
    """

    def __init__(self, model: Path, tokenizer: Path, *, threads: int = 2) -> None:
        self.width = _WIDTH
        self.fingerprint = model.name  # the catalogue pins the hash of the file of this name
        self._session = open_session(model, threads=threads)
        self._inputs = [node.name for node in self._session.get_inputs()]
        self._tokenizer = open_tokenizer(tokenizer, "minilm-tokenizer")
        self._tokenizer.enable_truncation(_MAX_TOKENS)
        self._tokenizer.enable_padding()

    def knows(self, word: str) -> bool:
        """Return whether a word, in lower case, is one of the frequent English words of the model's tokenizer."""
        return self._tokenizer.token_to_id(word) is not None

    def encode(self, texts: Sequence[str]) -> Float32:
        """Return one unit vector per text.

        Returns
        -------
        array of shape [len(texts), 384], float32
        """
        parts = [self._encode_batch(texts[i : i + _BATCH_SIZE]) for i in range(0, len(texts), _BATCH_SIZE)]
        return np.concatenate(parts) if parts else np.zeros((0, _WIDTH), np.float32)

    def _encode_batch(self, texts: Sequence[str]) -> Float32:
        encodings = self._tokenizer.encode_batch(list(texts))
        attention = np.array([encoding.attention_mask for encoding in encodings], np.int64)
        inputs = {
            "input_ids": np.array([encoding.ids for encoding in encodings], np.int64),
            "attention_mask": attention,
            "token_type_ids": np.array([encoding.type_ids for encoding in encodings], np.int64),
        }
        output = np.asarray(self._session.run(None, {name: inputs[name] for name in self._inputs})[0], np.float32)
        if output.ndim == 3:
            weights = attention[..., None].astype(np.float32)
            output = (output * weights).sum(axis=1) / weights.sum(axis=1)
        return normalized(output)
