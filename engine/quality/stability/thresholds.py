"""Pixels near a threshold: only there may float32 decide differently from float64."""

from __future__ import annotations

import torch

from ...rasterizer import project_centres, project_covariances
from ...rasterizer.settings import ALPHA_MAX, ALPHA_MIN, COV_MAX, DET_MIN, QUAT_NORM2_MIN, T_MIN
from .scenes import Scene

PIXELS_AT_ONCE = 2**21
"""Number of pairs of a pixel and a Gaussian that are processed at once, to limit memory."""


def pixels_near_thresholds(scene: Scene, near: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the pixels near a threshold of the picture, and those near one of the gradient; bool tensors [H, W].

    The computation is in float64 and independent of the ``cpu`` backend. It goes front to back over the Gaussians that
    a pixel's ray still reaches (transmittance before them at least T_MIN, less `near`). The picture may change
    discontinuously where alpha is within the relative distance `near` of ALPHA_MIN, or the transmittance behind a
    Gaussian within `near` of T_MIN. The gradient may do so at these pixels and where the alpha before clamping is
    within `near` of ALPHA_MAX, where the picture is continuous.
    """
    height, width = scene.camera.height, scene.camera.width
    pixels, conics, opacities = _in_depth_order(scene)
    ys, xs = torch.meshgrid(
        torch.arange(height, dtype=torch.float64) + 0.5, torch.arange(width, dtype=torch.float64) + 0.5, indexing="ij"
    )
    positions = torch.stack([xs.reshape(-1), ys.reshape(-1)], dim=1)
    blend = torch.zeros(height * width, dtype=torch.bool)
    gradient = torch.zeros(height * width, dtype=torch.bool)
    for part in torch.arange(height * width).split(max(1, PIXELS_AT_ONCE // max(1, len(pixels)))):
        d = positions[part, None] - pixels
        square = (
            conics[:, 0] * d[..., 0] ** 2 + 2 * conics[:, 1] * d[..., 0] * d[..., 1] + conics[:, 2] * d[..., 1] ** 2
        )
        raw = opacities * torch.exp(-0.5 * square)
        alpha = raw.clamp(max=ALPHA_MAX)
        alpha = alpha.where(alpha >= ALPHA_MIN, alpha.new_zeros(()))
        after = torch.cumprod(1.0 - alpha, dim=1)
        before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], dim=1)[:, : after.shape[1]]
        reached = before >= T_MIN * (1.0 - near)
        at_cut_off = (alpha > 0) & _close(after, T_MIN, near)
        blend[part] = (reached & (_close(raw, ALPHA_MIN, near) | at_cut_off)).any(dim=1)
        gradient[part] = blend[part] | (reached & _close(raw, ALPHA_MAX, near)).any(dim=1)
    return blend.reshape(height, width), gradient.reshape(height, width)


def _close(value: torch.Tensor, threshold: float, near: float) -> torch.Tensor:
    return (value - threshold).abs() <= near * threshold


def _in_depth_order(scene: Scene) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return centres [M, 2], inverse covariances xx, xy, yy [M, 3] and opacities [M] of the projected Gaussians."""
    viewmat = torch.tensor(scene.camera.viewmat, dtype=torch.float64)
    in_camera = scene.means @ viewmat[:3, :3].T + viewmat[:3, 3]
    kept = (in_camera[:, 2] > scene.settings.near) & ((scene.quats**2).sum(dim=1) >= QUAT_NORM2_MIN)
    order = torch.argsort(in_camera[:, 2].float(), stable=True)
    order = order[kept[order]]
    xx, xy, yy, det = project_covariances(
        in_camera[order], scene.quats[order], scene.scales[order], viewmat[:3, :3], scene.camera, scene.settings
    )
    sound = (det >= DET_MIN) & (torch.maximum(xx, yy) <= COV_MAX)
    conics = torch.stack([yy, -xy, xx], dim=1) / det[:, None]
    return project_centres(in_camera[order], scene.camera)[sound], conics[sound], scene.opacities[order][sound]
