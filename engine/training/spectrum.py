"""Share of the photos' detail that smaller pictures show; it decides how long these suffice for training."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import evenly_spaced_indices
from .views import TrainingView

MAX_PHOTOS = 8
"""Largest number of photos, evenly spaced, whose spectrum is computed."""


def coarse_shares(views: Sequence[TrainingView], n: int) -> tuple[float, ...]:
    """Return the share of the photos' spectrum that pictures reduced by sqrt(2) 0, 1, ... `n` times still show.

    Parameters
    ----------
    views : sequence of TrainingView
        Eight evenly spaced ones are used.

    Returns
    -------
    tuple of n + 1 floats
        Decreasing from 1. Sums of the amplitudes |F| whose frequencies are below the Nyquist frequency of the smaller
        picture on both axes, under a Hann window. Not of |F|^2, which is nearly all in the lowest frequencies. Invalid
        pixels are filled with the mean of the valid ones.
    """
    totals = np.zeros(n + 1)
    for index in evenly_spaced_indices(len(views), MAX_PHOTOS):
        amplitudes, frequency = _spectrum(views[index])
        totals += [float(amplitudes[frequency <= 2.0 ** (-k / 2)].sum()) for k in range(n + 1)]
    if totals[0] == 0.0:
        # One flat colour has no detail at any size.
        return (1.0,) * (n + 1)
    return tuple(float(share) for share in totals / totals[0])


def _spectrum(view: TrainingView) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the amplitudes and the higher frequency of both axes, relative to the Nyquist frequency of the picture."""
    gray = view.pixels.mean(axis=2, dtype=np.float64)
    valid = gray if view.valid is None else gray[view.valid]
    gray = gray - valid.mean()
    if view.valid is not None:
        gray[~view.valid] = 0.0
    height, width = gray.shape
    window = np.hanning(height)[:, None] * np.hanning(width)[None]
    rows, columns = 2.0 * np.abs(np.fft.fftfreq(height)), 2.0 * np.fft.rfftfreq(width)
    return np.abs(np.fft.rfft2(gray * window)), np.maximum(rows[:, None], columns[None])
