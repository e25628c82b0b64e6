"""What a text detector is: the few names the objects room relies on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Detection", "Detector", "PromptCheck"]


@dataclass(frozen=True)
class Detection:
    """A place in a photo that may show what was asked for.

    Attributes
    ----------
    box : tuple of 4 float
        x0, y0, x1, y1 in pixels of the picture that was given.
    score : float
        0 to 1, higher is better.
    label : str
        The detector's own word for it.
    region : int or None
        Id in the label map, where the detector chose among given segments.
    """

    box: tuple[float, float, float, float]
    score: float
    label: str
    region: int | None = None


@dataclass(frozen=True)
class PromptCheck:
    """Whether a detector understands a prompt.

    Attributes
    ----------
    known : bool
    matches : list of (str, float)
        What it takes the prompt for, or the nearest words it knows, with likeness 0 to 1, best first.
    message : str
        One sentence for the person.
    """

    known: bool
    matches: list[tuple[str, float]]
    message: str


class Detector(Protocol):
    """Finds what a text names in a photo."""

    name: str
    """As in the model catalogue; an object that was found by a text says which detector found it."""

    def knows(self, prompt: str) -> PromptCheck:
        """Return whether `prompt` can be looked for.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        ...

    def detect(
        self, pixels: NDArray[np.uint8], prompt: str, *, labels: NDArray[np.int32] | None = None
    ) -> list[Detection]:
        """Return what was found, best first; an empty list when nothing was.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB
        prompt : str
        labels : array of shape [h, w], int32, or None
            Label map of the same photo at any size (``masks.storage.read_label_map``): detections are then chosen
            among its segments and carry their id.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        ...

    def score_crops(
        self,
        pixels: NDArray[np.uint8],
        boxes: ArrayLike,
        prompt: str,
        *,
        masks: Sequence[NDArray[np.bool_]] | None = None,
    ) -> list[float]:
        """Return how well each box, or better each mask, shows what `prompt` names, 0 to 1.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB
        boxes : array-like of shape [n, 4]
            x0, y0, x1, y1 in pixels.
        prompt : str
        masks : sequence of n bool arrays of shape [H, W], or None
            The object in each box.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        ...

    def describe_crops(
        self, pixels: NDArray[np.uint8], boxes: ArrayLike, masks: Sequence[NDArray[np.bool_]]
    ) -> NDArray[np.float32] | None:
        """Return what each mask shows, for `score_described`, at a cost that allows hundreds of them.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB
        boxes : array-like of shape [n, 4]
            x0, y0, x1, y1 in pixels.
        masks : sequence of n bool arrays of shape [H, W]

        Returns
        -------
        float32 array of shape [n, D], or None
            None from a detector that must be told what to look for.
        """
        ...

    def score_described(self, described: NDArray[np.float32], prompt: str) -> list[float]:
        """Return how well each row of `described`, [n, D], shows what `prompt` names, as `score_crops` would.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        ...

    def name_crops(
        self, crops: Sequence[tuple[NDArray[np.uint8], ArrayLike, NDArray[np.bool_]]]
    ) -> list[tuple[str, float]]:
        """Return words for one thing that several photos show, each with a confidence 0 to 1, the best first.

        Parameters
        ----------
        crops : sequence of (pixels, box, mask)
            Pixels [H, W, 3], uint8; the box x0, y0, x1, y1 in them, and the thing's mask, bool [H, W].

        Returns
        -------
        list of (str, float)
            Empty without crops, and from a detector that can only be asked for given words.
        """
        ...
