"""OpenCV's pictures by their bytes: on Windows its own file names are limited to the letters of the code page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray


def read_picture(path: Path, flags: int = cv2.IMREAD_COLOR) -> NDArray[Any]:
    """Return what `cv2.imread` returns for a picture that OpenCV can read."""
    pixels = cv2.imdecode(np.fromfile(path, np.uint8), flags)
    assert pixels is not None, f"OpenCV cannot read {path.name}"
    return pixels


def write_picture(path: Path, pixels: NDArray[Any]) -> None:
    """Write a picture as `cv2.imwrite` does; the suffix is the format."""
    written, data = cv2.imencode(path.suffix, pixels)
    assert written, f"OpenCV cannot write {path.name}"
    data.tofile(path)
