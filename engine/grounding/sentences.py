"""Turns short texts into unit vectors whose dot product says how alike they mean (all-MiniLM-L6-v2, int8)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import EnvironmentProblem, ModelFileError
from ..models import open_session

__all__ = ["SentenceEncoder"]

_WIDTH = 384

_MAX_TOKENS = 256
_BATCH = 64


class SentenceEncoder:
    """all-MiniLM-L6-v2 through onnxruntime: mean over the token vectors, then unit length.

    Parameters
    ----------
    model, tokenizer : Path
        The ONNX file and its ``tokenizer.json``, from `models.catalogue.locate`.
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
        try:
            from tokenizers import Tokenizer
        except ImportError as error:
            raise EnvironmentProblem(
                "The package tokenizers is not in the engine's environment. Set up the engine anew."
            ) from error
        self.width = _WIDTH
        self.fingerprint = model.name  # the catalogue pins the file's hash to its name
        self._session = open_session(model, threads=threads)
        self._inputs = [given.name for given in self._session.get_inputs()]
        try:
            self._tokenizer = Tokenizer.from_file(str(tokenizer))
        except Exception as error:  # tokenizers raises the bare Exception
            raise ModelFileError(
                f"The tokenizer file {tokenizer} cannot be read ({error}). Run: python -m engine models fetch"
            ) from error
        self._tokenizer.enable_truncation(_MAX_TOKENS)
        self._tokenizer.enable_padding()

    def encode(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """Return one unit vector a text.

        Parameters
        ----------
        texts : sequence of str

        Returns
        -------
        array of shape [len(texts), 384], float32
        """
        parts = [self._encode_some(texts[i : i + _BATCH]) for i in range(0, len(texts), _BATCH)]
        return np.concatenate(parts) if parts else np.zeros((0, _WIDTH), np.float32)

    def _encode_some(self, texts: Sequence[str]) -> NDArray[np.float32]:
        encoded = self._tokenizer.encode_batch(list(texts))
        attention = np.array([one.attention_mask for one in encoded], np.int64)
        given = {
            "input_ids": np.array([one.ids for one in encoded], np.int64),
            "attention_mask": attention,
            "token_type_ids": np.array([one.type_ids for one in encoded], np.int64),
        }
        output = np.asarray(self._session.run(None, {name: given[name] for name in self._inputs})[0], np.float32)
        if output.ndim == 3:
            weights = attention[..., None].astype(np.float32)
            output = (output * weights).sum(axis=1) / weights.sum(axis=1)
        return np.asarray(output / np.linalg.norm(output, axis=1, keepdims=True), np.float32)
