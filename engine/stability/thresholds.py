"""Which pixels hang on a threshold: there float32 may honestly decide otherwise than float64, and nowhere else."""

from __future__ import annotations

import torch

from ..rasterizer import project_centres, project_covariances
from ..rasterizer.settings import ALPHA_MAX, ALPHA_MIN, COV_MAX, DET_MIN, QUAT_NORM2_MIN, T_MIN
from .scenes import Scene

__all__ = ["hanging_pixels"]

PIXELS_AT_ONCE = 2**21
"""Pairs of a pixel and a Gaussian that are looked at together, to bound memory."""


def hanging_pixels(scene: Scene, near: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the pixels whose picture, and those whose gradient, may jump; two bool tensors [H, W].

    Everything is float64 and independent of the ``cpu`` backend. Front to back over the pairs that are still reached
    (transmittance before them at least T_MIN, less `near`), a picture may jump where alpha lies within `near`
    (relative) of ALPHA_MIN, or the transmittance behind a pair within `near` of T_MIN. The gradient may jump there
    and where the alpha before clamping lies within `near` of ALPHA_MAX; the picture does not: clamping is continuous.
    """
    height, width = scene.camera.height, scene.camera.width
    pixels, conics, opacities = _in_depth_order(scene)
    ys, xs = torch.meshgrid(
        torch.arange(height, dtype=torch.float64) + 0.5, torch.arange(width, dtype=torch.float64) + 0.5, indexing="ij"
    )
    places = torch.stack([xs.reshape(-1), ys.reshape(-1)], dim=1)
    blend = torch.zeros(height * width, dtype=torch.bool)
    gradient = torch.zeros(height * width, dtype=torch.bool)
    for part in torch.arange(height * width).split(max(1, PIXELS_AT_ONCE // max(1, len(pixels)))):
        d = places[part, None] - pixels
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
    """Return centres [M, 2], inverse covariances xx, xy, yy [M, 3] and opacities [M] of what has an ellipse."""
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
