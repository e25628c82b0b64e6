"""What gsplat 1.5.3 and our earlier method reach on the same photos: mean PSNR of the test photos in dB.

gsplat trained on the same undistorted photos and sparse points with its own rates and the strategy of Kheradmand et al.
2024 (MCMC); 40,000 Gaussians (random rooms: 15,000), pictures of 640 pixels, 3,000 steps, seed 0. `GSPLAT` is of an
H200, the best on the way where it was higher than at the end; the statue, the store room and the random rooms ran on an
H100, and theirs is that of the end. `GSPLAT_FITTED`, with the brightness of each picture fitted to its photo, is of a
second run on an H100, at the end, by the forerunner of `python -m benchmarks.training.screening train FOLDER --variants
gsplat`; that command itself has not run on a GPU yet.

The earlier method is that of commit 06f55961, `standard` as planned for each set (1,223 to 3,000 steps).
"""

from __future__ import annotations

__all__ = ["BEFORE", "GSPLAT", "GSPLAT_FITTED"]

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
GSPLAT_FITTED = {
    "museum_room": 28.48,
    "skull66": 25.13,
    "sakharov_statue32": 18.41,
    "meeting_place9": 20.16,
    "banana16": 26.36,
    "herz_jesus25": 24.35,
    "store_room": 24.53,
    "room_1": 28.36,
    "room_3": 24.54,
}
BEFORE = {
    "museum_room": 29.72,
    "sakharov_statue32": 19.61,
    "skull66": 25.13,
    "meeting_place9": 18.82,
    "banana16": 24.80,
    "herz_jesus25": 21.88,
    "room_6": 32.35,
}
