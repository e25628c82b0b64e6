"""Buffers on a graphics card whose kernels are those of training."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...rasterizer.gpu import PLACES, RENDERING, Sources, Workspace
from ..losses.photometric_kernels import SSIM_C1, SSIM_C2, SSIM_WINDOW

_TRAINING = Path(__file__).parents[1]


class TrainingWorkspace(Workspace):
    """See `Workspace`; kernels are also read from ``gpu/shaders`` and ``losses``."""

    sources = Sources(
        (_TRAINING / "losses", _TRAINING / "gpu" / "shaders", *RENDERING.folders),
        (
            *((f"WINDOW_{i}", float(weight)) for i, weight in enumerate(SSIM_WINDOW)),
            ("SSIM_C1", float(SSIM_C1)),
            ("SSIM_C2", float(SSIM_C2)),
            ("BYTE", float(np.float32(1.0 / 255.0))),
        ),
    )
    # Each is written after the last use of the other one in a step or search.
    places = {
        **PLACES,
        "maps": "rows",
        "codes": "depth_keys",
        "high_codes": "offsets",
        "points": "geometry",
        "boxes": "info",
        "found": "rows",
    }
