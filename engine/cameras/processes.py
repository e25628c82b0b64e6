"""How many cores detect features and how many processes match pairs, as far as the memory suffices."""

from __future__ import annotations

from ..core.system import usable_cores

_PIXEL_BYTES = 260
"""Memory of detection per pixel of a working copy and core. SIFT works on a picture of twice the size."""
MATCHING_BYTES = 200_000_000
"""Memory of a process that matches, with 4,000 features of each photo."""
MIN_PAIRS = 40
"""Pairs of a share at least: starting one costs as much CPU time as matching five."""
_MAX_SHARE = 0.5
"""Share of the free memory that either may use: masks may be made beside."""


def cores_for(threads: int) -> int:
    """Return the number of cores that the setting `threads` stands for: 0 for all that this process may use."""
    return threads if threads > 0 else len(usable_cores())


def detection_bytes(pixels: float) -> float:
    """Return the memory of a core that detects features in a working copy of so many `pixels`, in bytes."""
    return _PIXEL_BYTES * pixels


def detecting_cores(cores: int, pixels: float, *, free: int | None) -> int:
    """Return how many of the `cores` detect features.

    Parameters
    ----------
    pixels : float
        Of the largest working copy.
    free : int or None
        Free memory in bytes, None where it is unknown.
    """
    return _fitting(cores, detection_bytes(pixels), free)


def matching_processes(cores: int, n_pairs: int, *, free: int | None) -> int:
    """Return how many processes on one core each match `n_pairs` pairs; 1 is the process of the cameras itself."""
    return _fitting(max(1, min(cores, n_pairs // MIN_PAIRS)), MATCHING_BYTES, free)


def _fitting(most: int, n_bytes: float, free: int | None) -> int:
    return most if free is None else max(1, min(most, int(_MAX_SHARE * free / n_bytes)))
