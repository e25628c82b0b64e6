"""Types of arrays, as all packages name them, and what is computed of arrays everywhere. NumPy only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Floats = NDArray[np.floating]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Mask = NDArray[np.bool_]
Pixels = NDArray[np.uint8]


def normalized(vectors: Floats) -> Float32:
    """Return `vectors`, [..., D], at unit length; zero vectors stay zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors, dtype=np.float32), where=lengths > 1e-12)


def evenly_spaced_indices(n: int, n_max: int) -> list[int]:
    """Return at most `n_max` of the indices 0 to `n` - 1, evenly spaced, with the first and the last one."""
    return [int(index) for index in np.linspace(0, n - 1, min(n_max, n)).round()]
