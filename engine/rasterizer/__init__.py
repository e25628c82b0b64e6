"""Differentiable rasterization of 3D Gaussians with any number of channels.

`rasterize` takes Gaussians and a camera and returns a `Raster`. `CachedView` renders the same Gaussians many times from one
camera, and `GpuScene` on a graphics card from any camera. Vector instructions and threads of Numba kernels (`JIT`, `fma`,
`run_shared`) are public, because kernels of training are built from them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .api import rasterize, scene_on_card
    from .cached_view import CachedView
    from .compilation import compile_backward, compile_forward, garbage_collection_paused
    from .devices import (
        PROCESSOR,
        Device,
        choose_device,
        device_words,
        fallback,
        look_for_card,
        run_on,
        training_stopped,
    )
    from .finite import all_finite
    from .gpu import GpuScene
    from .jit import INNER, JIT, cache_folder
    from .raster import CulledCounts, Raster, check_camera, check_finite
    from .reference import project_centres, project_covariances, rotation_matrices
    from .settings import MAX_CHANNELS
    from .simd import fma, load, select, splat, store
    from .threads import Share, new_counters, run_shared, take_range

__getattr__ = lazy_exports(__name__, __file__)
