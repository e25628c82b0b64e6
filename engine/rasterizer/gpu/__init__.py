"""The ``gpu`` backend: one WGSL source for all graphics cards, run by wgpu over Vulkan, Metal or DirectX 12.

`open_gpu` opens a card after a self-test against the ``cpu`` backend. `Frame` holds the buffers of one image size and
encodes its forward and backward pass. `GpuScene` makes pictures and votes of Gaussians that stay on the card. The other
names are what training steps on a card (`engine.training.gpu`) are built from. See docs/graphics_cards.md and docs/design_notes/gpu.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .adapters import Gpu, describe_adapters, open_adapter, translate_card_errors
    from .autograd import rasterize_gpu
    from .constants import Uniform
    from .frame import Frame, camera_values
    from .layout import BLOCK, FrameSize, grown_capacity, pack_sh, sh_bytes, sh_ranges, unpack_sh, with_room
    from .scene import GpuScene
    from .self_test import open_gpu
    from .shaders import RENDERING, Sources
    from .submissions import Dispatch, Submissions, Timings, encode, run_together, wait_until_done
    from .tested import forget_passes, keep_pass, passed_before, passed_elsewhere
    from .workspace import PLACES, STORAGE, Workspace

__getattr__ = lazy_exports(__name__, __file__)
