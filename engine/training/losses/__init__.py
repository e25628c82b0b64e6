"""The losses of training, a module each: on the processor, on a graphics card, and the kernels of the card in WGSL.

L = L_rendering + lambda_clustering L_CC + L_reg (Dahaghin et al. 2024), see `photometric_loss`, `clustering_loss` and
`neighbour_regulariser`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .clustering import (
        ClusteringSample,
        LabelledPixels,
        clustering_loss,
        drawn_pixels,
        labelled_pixels,
    )
    from .exposure import GpuExposures
    from .neighbours import (
        N_ANCHORS,
        N_FAR,
        N_FAR_CANDIDATES,
        N_NEIGHBOURS,
        NeighbourSample,
        drawn_anchors,
        nearest_neighbours,
        neighbour_regulariser,
    )
    from .paper import PaperSample, drawn_of_paper, paper_regulariser
    from .photometric import Target, photometric_loss, ssim
    from .rays import ray_disagreement
    from .samples import CardLoss, Sample

__getattr__ = lazy_exports(__name__, __file__)
