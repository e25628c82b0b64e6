"""Vectors of texts that are always the same, kept between runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...core.arrays import Float32
from ...core.errors import FormatError
from ...core.files import ArraySpec, atomic_write, read_array
from ...project.folder import stage_key


def kept_vectors(
    folder: Path | None,
    texts: Sequence[str],
    encode: Callable[[Sequence[str]], Float32],
    *,
    fingerprint: str,
    width: int,
) -> Float32:
    """Return the vector of each text, of which a file is kept; a missing or damaged file is made again.

    Parameters
    ----------
    folder : Path or None
        None keeps nothing.
    encode : callable
        Returns the vectors of texts, [n, width].
    fingerprint : str
        Names what `encode` computes.

    Returns
    -------
    array of shape [len(texts), width], float32
    """
    file = None
    if folder is not None:
        file = folder / f"class-words-{stage_key(list(texts), fingerprint)[:16]}.npy"
        try:
            return read_array(file, ArraySpec("float32", (len(texts), width), finite=True), advice="It is made again.")
        except FormatError:
            pass  # missing or damaged: computed below, and replaced
    # Texts of similar length are encoded together, because padding would otherwise cost more than the words.
    order = np.argsort([len(text) for text in texts], kind="stable")
    vectors = np.empty((len(texts), width), np.float32)
    vectors[order] = encode([texts[i] for i in order])
    if file is not None:
        with atomic_write(file) as stream:
            np.save(stream, vectors)
    return vectors
