"""Lowest acceptable PSNR of each case of training. It follows from the capture, not from the results of training.

``flat``
    PSNR of one flat colour, the mean of the training photos: the result of a training that learns only the mean colour.
``undisturbed - d``
    PSNR of the first case in the same run of the suite, less d dB; "without points" if the case has no sparse points.
``known``
    PSNR of the true Gaussians seen through the wrong cameras of the case, or ``flat`` if that is higher. The best
    result for wrong cameras is at least as good as the truth.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...cameras import normalised_viewmat, original_from_world
from ...core.arrays import Pixels
from ...scene import Gaussians
from .training_measure import measure_training
from .training_scenes import SETTINGS, Capture, known_capture, pinhole, render_pixels, training_input

EASIER_DB = 0.0
"""dB below the undisturbed case for captures with less to learn."""
SAME_RUN_DB = 1.0
"""dB below it for runs that are equal in exact arithmetic: float32 rounds differently, and 120 steps amplify that."""
SIMILAR_RUN_DB = 3.0
"""dB below it for photos with as much information but other initial Gaussians or random draws: 1.4 times the error."""
UNTEXTURED_DB = 6.0
"""dB below it for photos without texture. Gaussians may be at any depth, so other views have holes, as without points,
and a black hole in white is twice the error of one in a picture of medium brightness."""
OVERFIT_DB = 6.0
"""dB below it for more values than the training photos have: 5,296 Gaussians of 14 values against 46,656 values of nine
photos. The photos do not determine such a result between them, and training amplifies rounding: starts that differ by
one float32 step give 25.0 to 29.0 dB (mean 27.2, standard deviation 1.2), other random seeds 24.9 to 33.8 dB. See
docs/design_notes/stability.md."""
ABOVE_FLAT_DB = 6.0
"""dB above one flat colour for the undisturbed case: half of its error."""


@dataclass(frozen=True)
class Floor:
    """Lowest PSNR with which a case counts as finished.

    Attributes
    ----------
    rule : str
        Name of the rule, as in the module's docstring.
    value : callable
        Returns the PSNR in dB.
    """

    rule: str
    value: Callable[[], float]


def flat_floor(capture: Callable[[], Capture], *, above: float = 0.0) -> Floor:
    """Return the floor of one flat colour, plus `above` dB."""
    return Floor(f"flat + {above:g}" if above else "flat", lambda: _flat_psnr(capture()) + above)


def undisturbed_floor(below: float, *, points: bool = True) -> Floor:
    """Return the floor of the undisturbed case, with or without its sparse points, less `below` dB."""
    rule = "undisturbed" + ("" if points else " without points") + (f" - {below:g}" if below else "")
    return Floor(rule, lambda: _undisturbed_psnr(points) - below)


def known_floor(capture: Callable[[], Capture]) -> Floor:
    """Return the floor of the true Gaussians seen through the wrong cameras of `capture`."""

    def value() -> float:
        wrong, truth = capture(), known_capture()[1]
        _, evaluated = wrong.split()
        pictures = [render_pixels(truth, pinhole(wrong.viewmats[i], wrong.focal)) for i in evaluated]
        return max(_mean_psnr(pictures, [wrong.photos[i] for i in evaluated]), _flat_psnr(wrong))

    return Floor("known", value)


def training_psnr(gaussians: Gaussians, capture: Capture) -> float:
    """Return the mean PSNR in dB of `gaussians` on the photos of `capture` that are trained on."""
    training, _ = capture.split()
    similarity = original_from_world(list(capture.viewmats), capture.points)
    viewmats = [normalised_viewmat(capture.viewmats[i], similarity) for i in training]
    pictures = [render_pixels(gaussians, pinhole(viewmat, capture.focal)) for viewmat in viewmats]
    return _mean_psnr(pictures, [capture.photos[i] for i in training])


def _flat_psnr(capture: Capture) -> float:
    training, evaluated = capture.split()
    color = np.mean([capture.photos[i].reshape(-1, 3).mean(axis=0) for i in training], axis=0)
    photos = [capture.photos[i] for i in evaluated]
    return _mean_psnr([np.broadcast_to(color, photo.shape) for photo in photos], photos)


def _mean_psnr(pictures: list[Pixels], photos: list[Pixels]) -> float:
    """Return the mean PSNR in dB of pictures with values 0 to 255. No picture may equal its photo."""
    squares = [np.square((a - b.astype(np.float64)) / 255.0).mean() for a, b in zip(pictures, photos, strict=True)]
    return float(-10.0 * np.log10(squares).mean())


@functools.cache
def _undisturbed_psnr(points: bool) -> float:
    capture = known_capture()[0] if points else known_capture()[0].without_points()
    finding = measure_training(lambda: (training_input(capture, SETTINGS), SETTINGS))
    if finding.psnr is None:
        raise AssertionError(f"the undisturbed case, on which other floors depend, was refused: {finding.message}")
    return finding.psnr
