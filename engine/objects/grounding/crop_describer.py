"""Base of detectors that describe crops: segments are described, and the descriptions scored."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from ...core.arrays import Float32, Int32, Mask, Pixels, normalized
from ...masks import mask_box
from .crops import Box
from .detector import Detection, Detector

# Segments that cover a smaller or larger fraction of the photo are not described.
_MIN_SEGMENT_FRACTION = 0.001  # chosen on museum_room
_MAX_SEGMENT_FRACTION = 0.5  # chosen on museum_room
_STEEPNESS = 12.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Log-odds of a word for a cosine of 1 with its examples, less those for 0."""
_OFFSET = 6.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Negative log-odds of a word for what has nothing in common with its examples."""
_N_USUAL = 40
"""Crops of things in other scenes that the centre of a scene counts in addition: the few of a scene of one object show
all the same, which is then nothing that all scenes have in common."""


class CropDescriber(Detector, ABC):
    """A detector that describes crops: `Detector.detect` by its descriptions."""

    least_score = 0.0
    """Detections with a lower score are discarded."""

    def detect(self, pixels: Pixels, prompt: str, *, labels: Int32 | None = None) -> list[Detection]:
        """Return the detections among the segments of a photo, best first; see `Detector.detect`."""
        if labels is None:
            return []
        if labels.shape != pixels.shape[:2]:
            labels = cv2.resize(labels, pixels.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        numbers, areas = np.unique(labels, return_counts=True)
        share = areas / labels.size
        suitable = (numbers > 0) & (share >= _MIN_SEGMENT_FRACTION) & (share <= _MAX_SEGMENT_FRACTION)
        masks = [labels == number for number in numbers[suitable]]
        boxes = [as_box(mask_box(mask)) for mask in masks]
        rows = self.describe_segments(pixels, boxes, masks)
        found = [
            Detection(box, score, self.word_for(row, prompt), int(number))
            for box, score, row, number in zip(
                boxes, self.score_descriptions(rows, prompt), rows, numbers[suitable], strict=True
            )
        ]
        return sorted((one for one in found if one.score >= self.least_score), key=lambda one: -one.score)

    def score_examples(self, described: Float32, means: Float32) -> Float32:
        """Return how much each row looks like the examples of each word, [n, W]; see `Detector.score_examples`.

        It is the cosine of their directions from the centre: from what the rows, and things in other scenes, have in
        common. Without that, all of a scene would be alike.
        """
        if len(described) == 0:
            return np.zeros((0, len(means)), np.float32)
        vectors = self.example_vectors(described)
        usual = self.usual_example()
        common, count = vectors.sum(axis=0), len(vectors)
        if usual is not None:
            common, count = common + _N_USUAL * usual, count + _N_USUAL
        centre = common / count
        cosines = normalized(vectors - centre) @ normalized(means - centre).T
        return np.asarray(expit(_STEEPNESS * cosines - _OFFSET), np.float32)

    @abstractmethod
    def usual_example(self) -> Float32 | None:
        """Return the mean of `example_vectors` over things in many scenes, [E]; None where it is not known."""

    @abstractmethod
    def describe_segments(self, pixels: Pixels, boxes: Sequence[Box], masks: Sequence[Mask]) -> Float32:
        """Return a description of each segment of a photo, [n, d], which may be less than `describe_crops` tells."""

    @abstractmethod
    def word_for(self, row: Float32, prompt: str) -> str:
        """Return the detector's word for what a description, [d], shows of a prompt."""


def as_box(corners: ArrayLike | None) -> Box:
    """Return x0, y0, x1, y1 as numbers."""
    x0, y0, x1, y1 = (float(value) for value in np.asarray(corners, np.float64).ravel())
    return x0, y0, x1, y1


def as_boxes(boxes: ArrayLike) -> list[Box]:
    """Return boxes, array-like of shape [n, 4], one by one."""
    return [as_box(box) for box in np.asarray(boxes, np.float64).reshape(-1, 4)]
