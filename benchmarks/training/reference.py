"""What gsplat 1.5.3 reaches on the same photos: mean PSNR of the test photos in dB.

gsplat trained on the same undistorted photos and sparse points with its own rates and the strategy of Kheradmand et al.
2024 (MCMC); 40,000 Gaussians (random rooms: 15,000), pictures of 640 pixels, 3,000 steps, on an H100: means of seeds 0
to 2 at the end of the run, by `python -m benchmarks.training.card train FOLDER --backend gsplat --runs 3000:40000
--seeds 0,1,2` (random rooms: ``3000:15000``).
`GSPLAT_FITTED` is with the brightness of each picture fitted to its photo.
"""

from __future__ import annotations

GSPLAT = {
    "herz_jesus25": 23.86,
    "meeting_place9": 19.35,
    "banana16": 26.31,
    "sakharov_statue32": 18.39,
    "skull66": 23.86,
    "museum_room": 27.80,
    "store_room": 24.22,
    "room_6": 29.73,
    "room_8": 25.58,
}
GSPLAT_FITTED = {
    "herz_jesus25": 24.23,
    "meeting_place9": 19.38,
    "banana16": 26.45,
    "sakharov_statue32": 18.66,
    "skull66": 25.16,
    "museum_room": 28.37,
    "store_room": 24.43,
    "room_6": 30.29,
    "room_8": 25.81,
}
