"""How much of the photos' detail is coarse: what decides for how long small pictures are enough to learn from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .views import TrainingView

__all__ = ["TYPICAL_SHARES", "coarse_shares"]

_MOST_PHOTOS = 8

TYPICAL_SHARES = (1.0, 0.91, 0.78, 0.63, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.1)
"""Of pictures made smaller by sqrt(2) 0, 1, ... 10 times, where photos were not looked at: means over a museum room, a
statue, a skull and bananas for the first five, continued."""


def coarse_shares(views: Sequence[TrainingView], n: int) -> tuple[float, ...]:
    """Return the share of the photos' spectrum that pictures made smaller by sqrt(2) 0, 1, ... `n` times still show.

    Parameters
    ----------
    views : sequence of TrainingView
        Eight that are evenly spread are looked at.
    n : int

    Returns
    -------
    tuple of n + 1 floats
        From 1 falling. Sums of amplitudes |F| (not of |F|^2: their squares are nearly all in the first few waves)
        whose frequencies lie below the Nyquist frequency of the smaller picture on both axes, under a Hann window.
        Pixels that do not count are filled with the mean of the others.
    """
    totals = np.zeros(n + 1)
    for index in np.linspace(0, len(views) - 1, min(_MOST_PHOTOS, len(views))).round().astype(int):
        amplitudes, frequency = _spectrum(views[index])
        totals += [float(amplitudes[frequency <= 2.0 ** (-k / 2)].sum()) for k in range(n + 1)]
    if totals[0] == 0.0:
        # Nothing but one flat colour: there is no detail at any size.
        return (1.0,) * (n + 1)
    return tuple(float(share) for share in totals / totals[0])


def _spectrum(view: TrainingView) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return amplitudes and, relative to the picture's own Nyquist frequency, the higher frequency of both axes."""
    gray = view.pixels.mean(axis=2, dtype=np.float64)
    counted = gray if view.valid is None else gray[view.valid]
    gray = gray - counted.mean()
    if view.valid is not None:
        gray[~view.valid] = 0.0
    height, width = gray.shape
    window = np.hanning(height)[:, None] * np.hanning(width)[None]
    rows, columns = 2.0 * np.abs(np.fft.fftfreq(height)), 2.0 * np.fft.rfftfreq(width)
    return np.abs(np.fft.rfft2(gray * window)), np.maximum(rows[:, None], columns[None])
