"""Types of the arrays of this package, and how many sets of Gaussians are processed together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["SETS_TOGETHER", "Float32", "Float64", "Floats", "Int32", "Int64", "Mask", "Pixels", "Place"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Floats = NDArray[np.floating]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Mask = NDArray[np.bool_]
Pixels = NDArray[np.uint8]
Place = tuple[float, float]
"""x, y in pixels of a picture from its top left corner."""

SETS_TOGETHER = 16  # by definition
"""Sets of Gaussians that are solved or rendered together. More need more memory and are hardly faster."""
