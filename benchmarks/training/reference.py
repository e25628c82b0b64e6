"""What gsplat 1.5.3 and our earlier method reach on the same photos: mean PSNR of the test photos in dB.

gsplat trained on the same undistorted photos and sparse points with its own rates and the strategy of Kheradmand et al.
2024 (MCMC); 40,000 Gaussians (random rooms: 15,000), pictures of 640 pixels, 3,000 steps, on an H200: the best on the
way, where it was higher than at the end. The statue, the store room and the random rooms ran on an H100, and theirs is
that of the end.

The earlier method is that of commit 06f55961, `standard` as planned for each set (1,223 to 3,000 steps).
"""

from __future__ import annotations

__all__ = ["BEFORE", "GSPLAT"]

GSPLAT = {
    "museum_room": 27.77,
    "skull66": 24.52,
    "sakharov_statue32": 18.16,
    "meeting_place9": 19.98,
    "banana16": 26.24,
    "herz_jesus25": 23.99,
    "store_room": 24.34,
    "room_1": 26.07,
    "room_3": 24.01,
}
BEFORE = {
    "museum_room": 29.72,
    "sakharov_statue32": 19.61,
    "skull66": 25.13,
    "meeting_place9": 18.82,
    "banana16": 24.80,
    "herz_jesus25": 21.88,
}
