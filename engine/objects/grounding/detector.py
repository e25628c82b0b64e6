"""The interface of a text detector, as the objects package uses it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from ...core.arrays import Float32, Int32, Mask, Pixels


@dataclass(frozen=True)
class Detection:
    """A box in a photo that may show what the prompt describes.

    Attributes
    ----------
    box : tuple of 4 float
        x0, y0, x1, y1 in pixels of the given picture.
    score : float
        0 to 1, higher is better.
    label : str
        The detector's word for the object.
    region : int or None
        Id in the label map, if the detector selected one of the given segments.
    """

    box: tuple[float, float, float, float]
    score: float
    label: str
    region: int | None = None


@dataclass(frozen=True)
class PromptCheck:
    """Result of checking whether a detector understands a prompt.

    Attributes
    ----------
    known : bool
        Whether the detector can look for the prompt.
    matches : list of (str, float)
        The detector's words for the prompt, or the nearest words if it is not known, with similarity 0 to 1, best
        first.
    message : str
        One sentence for the user.
    misspelt : bool
        Whether `matches` are words that are spelt nearly like an unknown prompt.
    """

    known: bool
    matches: list[tuple[str, float]]
    message: str
    misspelt: bool = False


def _no_descriptions(name: str) -> NotImplementedError:
    return NotImplementedError(f"{name} returns no descriptions")


class Detector(Protocol):
    """Finds what a text describes in a photo.

    One that needs the text to process a picture describes no crops: `describe_crops` returns None, and the methods that
    take descriptions are never called.
    """

    name: str
    """Name in the model catalogue, stored with every object that the detector finds."""

    fingerprint: str
    """Differs between versions of its `example_vectors`; empty for a detector that describes no crops."""

    def check_prompt(self, prompt: str) -> PromptCheck:
        """Return whether the detector can look for `prompt`.

        Raises
        ------
        PromptError
            When `prompt` is empty.
        """
        ...

    def detect(self, pixels: Pixels, prompt: str, *, labels: Int32 | None = None) -> list[Detection]:
        """Return the detections, best first.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB
        labels : array of shape [h, w], int32, or None
            Label map of the same photo at any size (`masks.read_label_map`). Detections are then selected from its
            segments and contain their ids. Without it, a detector that describes crops detects nothing.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        ...

    def describe_crops(self, pixels: Pixels, boxes: ArrayLike, masks: Sequence[Mask]) -> Float32 | None:
        """Return a description of each mask for `score_descriptions`, cheap enough for hundreds of masks.

        Parameters
        ----------
        pixels : array of shape [H, W, 3], uint8, sRGB
        boxes : array-like of shape [n, 4]
            x0, y0, x1, y1 in pixels.
        masks : sequence of n bool arrays of shape [H, W]

        Returns
        -------
        float32 array of shape [n, D], or None
            None if the detector needs the prompt to process a picture.
        """
        return None

    def score_descriptions(self, described: Float32, prompt: str) -> list[float]:
        """Return how well each row of `described`, [n, D], matches `prompt`, 0 to 1.

        Raises
        ------
        PromptError
            When the prompt is empty or not known.
        """
        raise _no_descriptions(self.name)

    def score_unknown(self, described: Float32, prompt: str) -> list[float] | None:
        """Return how well each row of `described`, [n, D], matches a prompt that is not known; None for no idea of it.

        It tells which objects come first among those that are offered. Nothing is found by it.

        Raises
        ------
        PromptError
            When the prompt is empty.
        """
        return None

    def score_vocabulary(self, described: Float32) -> Float32:
        """Return how well each row of `described`, [n, D], matches each of V words, few of which a scene shows.

        They name things that people make, as most texts do. Animals look so unlike these that they refuse too little.

        Returns
        -------
        array of shape [n, V], float32
            As `score_descriptions` returns them.
        """
        raise _no_descriptions(self.name)

    def example_vectors(self, described: Float32) -> Float32:
        """Return what is kept of each row of `described`, [n, D], as an example of a word that a user teaches, [n, E].

        The mean of the rows of one object is an example.
        """
        raise _no_descriptions(self.name)

    def score_examples(self, described: Float32, means: Float32) -> Float32:
        """Return how well each row of `described`, [n, D], matches each of W words that were taught, [n, W].

        Parameters
        ----------
        described : array of shape [n, D], float32
        means : array of shape [W, E], float32
            Means of the examples of each word.

        Returns
        -------
        array of shape [n, W], float32
            Like `score_descriptions`.
        """
        raise _no_descriptions(self.name)

    def whole_odds(self, described: Float32) -> Float32:
        """Return what each crop adds to the log-odds of being one whole thing.

        Parameters
        ----------
        described : array of shape [n, D], float32
            By `describe_crops`.

        Returns
        -------
        array of shape [n], float32
            Negative for a part of a thing and for several things; zero when the detector cannot tell.
        """
        raise _no_descriptions(self.name)

    def fitting_word(self, described: Float32, prompt: str) -> str:
        """Return the word that one object clearly is instead of `prompt`, which it therefore is not; empty for none.

        Parameters
        ----------
        described : array of shape [n, D], float32
            Descriptions of the object in n > 0 photos, by `describe_crops`.
        prompt : str
            That the detector knows.
        """
        return ""

    def name_descriptions(self, described: Float32) -> list[tuple[str, float]]:
        """Return words for one object that several photos show, each with a confidence 0 to 1, best first.

        Parameters
        ----------
        described : array of shape [n, D], float32
            Descriptions of the object in n photos, by `describe_crops`.

        Returns
        -------
        list of (str, float)
            Empty without rows, and for a detector that has no words of its own.
        """
        return []
