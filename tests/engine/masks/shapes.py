"""A synthetic picture of coloured shapes with known masks."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

HEIGHT, WIDTH = 480, 640


def shapes_picture(seed: int = 0) -> tuple[NDArray[np.uint8], dict[str, NDArray[np.bool_]]]:
    """Return the picture and the mask of each shape, by name."""
    generator = np.random.default_rng(seed)
    picture = np.full((HEIGHT, WIDTH, 3), (196, 190, 178), np.uint8)
    masks: dict[str, NDArray[np.bool_]] = {}

    def draw(name: str, color: tuple[int, int, int], polygon: NDArray[np.int32] | None = None) -> None:
        canvas = np.zeros((HEIGHT, WIDTH), np.uint8)
        if polygon is None:
            cv2.circle(canvas, (150, 140), 75, 1, -1)
        else:
            cv2.fillPoly(canvas, [polygon], 1)
        masks[name] = canvas > 0
        picture[masks[name]] = color

    draw("disk", (180, 40, 40))
    draw("square", (30, 70, 170), np.array([[400, 60], [560, 60], [560, 220], [400, 220]], np.int32))
    draw("triangle", (40, 130, 60), np.array([[120, 430], [220, 280], [320, 430]], np.int32))
    draw("diamond", (220, 170, 30), np.array([[490, 290], [560, 365], [490, 440], [420, 365]], np.int32))
    noise = generator.normal(0, 3, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8), masks


def iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    """Return the intersection over union."""
    return float(np.count_nonzero(a & b) / max(1, np.count_nonzero(a | b)))
