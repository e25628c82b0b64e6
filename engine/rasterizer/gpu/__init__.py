"""The ``gpu`` backend: one WGSL source for all graphics cards, run by wgpu over Vulkan, Metal or DirectX 12.

`open_gpu` opens a card after a self-test against the ``cpu`` backend. `Frame` holds the buffers of one image size and
encodes its forward and backward pass. `GpuTrainer` makes training steps whose data stay on the card,
`GpuScene` pictures and votes of Gaussians that stay there. See docs/graphics_cards.md and docs/design_notes/gpu.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .adapters import Gpu, describe_adapters, open_adapter
    from .autograd import rasterize_gpu
    from .clustering import ClusteringSample
    from .exposure import GpuExposures
    from .frame import Frame
    from .layout import FrameSize
    from .neighbours import NeighbourSample
    from .paper import PaperSample
    from .parameters import GpuParameters
    from .plans import StepPlan
    from .scene import GpuScene
    from .self_test import open_gpu
    from .step import GpuTrainer
    from .training_frame import Dropout, PositionNoise

__all__ = [
    "ClusteringSample",
    "Dropout",
    "Frame",
    "FrameSize",
    "Gpu",
    "GpuExposures",
    "GpuParameters",
    "GpuScene",
    "GpuTrainer",
    "NeighbourSample",
    "PaperSample",
    "PositionNoise",
    "StepPlan",
    "describe_adapters",
    "open_adapter",
    "open_gpu",
    "rasterize_gpu",
]

__getattr__ = lazy_exports(__name__, __file__)
