"""Agreement of features along the rays of a picture. On a card it is part of ray_gradient.wgsl and loss_total.wgsl."""

from __future__ import annotations

import torch


def ray_disagreement(features: torch.Tensor, transmittance: torch.Tensor) -> torch.Tensor:
    """Return the mean variance of unit features along the rays of a picture.

    Parameters
    ----------
    features : tensor of shape [h, w, F]
        Blended features F = sum_g w_g f_g with |f_g| = 1.
    transmittance : tensor of shape [h, w]
        1 - A with A = sum_g w_g.

    Returns
    -------
    tensor, scalar
        Mean of A^2 - |F|^2 = sum_gh w_g w_h (1 - f_g . f_h), which is 0 exactly where all features along a ray agree.

    Notes
    -----
    The variance regulariser of OpenSplat3D (CVPRW 2025) without its second rendering: for unit features the blended
    squares equal A.
    """
    cover = 1.0 - transmittance
    return (cover.square() - features.square().sum(dim=2)).mean()
