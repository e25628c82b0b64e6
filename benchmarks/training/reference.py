"""What gsplat 1.5.3 reaches on the same undistorted photos, sparse points and test photos, with its own rates.

Measured on an H200 with the strategy of Kheradmand et al. 2024 (MCMC); 40,000 Gaussians, pictures of 640 pixels, mean
PSNR of the test photos in dB. The second number of a pair is the best on the way, where it was higher.
"""

from __future__ import annotations

__all__ = ["AT_3000_STEPS", "AT_SAME_STEPS"]

AT_SAME_STEPS = {
    "museum_room": 27.77,
    "sakharov_statue32": 18.14,
    "skull66": 24.52,
    "meeting_place9": 17.84,
    "banana16": 25.52,
    "herz_jesus25": 23.27,
}
AT_3000_STEPS = {
    "museum_room": 27.77,
    "skull66": 24.52,
    "meeting_place9": 19.98,
    "banana16": 26.24,
    "herz_jesus25": 23.99,
}
