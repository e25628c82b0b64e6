"""The least PSNR of each case of training. It comes from what the capture allows, not from what training reached.

``flat``
    One flat colour, the mean of the photos trained on. Whoever learnt nothing of a scene but its colour gets as far.
``undisturbed - d``
    The same capture undisturbed, trained in the same run of the suite, less d dB; "without points" where the case has
    none either.
``known``
    The Gaussians that the photos are of, through cameras that are all wrong in the same way; or ``flat``, if that is
    more. The best compromise is at least as good as the truth.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .training_measure import measured_run
from .training_scenes import SETTINGS, Capture, Pixels, known_capture, pinhole, rendered, training_input

__all__ = ["EASIER", "HOLES", "LEARNT", "SAME", "SIMILAR", "Floor", "flat", "known", "undisturbed"]

EASIER = 0.0
"""dB below the undisturbed case: for what leaves less to learn."""
SAME = 1.0
"""For what is the same run in exact arithmetic: float32 rounds otherwise, and 120 steps make more of it."""
SIMILAR = 3.0
"""For photos that say as much, with other Gaussians to start from or other random draws: 1.4 times the error."""
HOLES = 6.0
"""For photos without texture: Gaussians may lie at any depth, so other views have holes as without points, and a black
hole in white is twice the error of one in a picture of middling brightness."""
LEARNT = 6.0
"""Above one flat colour: half of its error."""


@dataclass(frozen=True)
class Floor:
    """The least PSNR that counts as finishing.

    Attributes
    ----------
    rule : str
        As in the module's docstring.
    value : callable
        Gives it in dB.
    """

    rule: str
    value: Callable[[], float]


def flat(capture: Callable[[], Capture], *, above: float = 0.0) -> Floor:
    """Return the floor of one flat colour, plus `above` dB."""
    return Floor(f"flat + {above:g}" if above else "flat", lambda: _flat_psnr(capture()) + above)


def undisturbed(below: float, *, points: bool = True) -> Floor:
    """Return the floor of the undisturbed case, with its sparse points or without any, less `below` dB."""
    rule = "undisturbed" + ("" if points else " without points") + (f" - {below:g}" if below else "")
    return Floor(rule, lambda: _undisturbed_psnr(points) - below)


def known(capture: Callable[[], Capture]) -> Floor:
    """Return the floor of the known Gaussians through the cameras of `capture`, which are wrong."""

    def value() -> float:
        wrong, truth = capture(), known_capture()[1]
        _, measured = wrong.split()
        pictures = [rendered(truth, pinhole(wrong.viewmats[i], wrong.focal)) for i in measured]
        return max(_mean_psnr(pictures, [wrong.photos[i] for i in measured]), _flat_psnr(wrong))

    return Floor("known", value)


def _flat_psnr(capture: Capture) -> float:
    training, measured = capture.split()
    color = np.mean([capture.photos[i].reshape(-1, 3).mean(axis=0) for i in training], axis=0)
    photos = [capture.photos[i] for i in measured]
    return _mean_psnr([np.broadcast_to(color, photo.shape) for photo in photos], photos)


def _mean_psnr(pictures: list[Pixels], photos: list[Pixels]) -> float:
    """Return the mean PSNR in dB of pictures of values 0 to 255, none of which is exact."""
    squares = [np.square((a - b.astype(np.float64)) / 255.0).mean() for a, b in zip(pictures, photos, strict=True)]
    return float(-10.0 * np.log10(squares).mean())


@functools.cache
def _undisturbed_psnr(points: bool) -> float:
    capture = known_capture()[0] if points else known_capture()[0].without_points()
    finding = measured_run(lambda: (training_input(capture, SETTINGS), SETTINGS))
    if finding.psnr is None:
        raise AssertionError(f"the undisturbed case, which others are measured by, was refused: {finding.said}")
    return finding.psnr
