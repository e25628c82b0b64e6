"""The ``reference`` backend: the rasterizer in plain torch, differentiated by autograd, in the dtype of its inputs.

It is slow and short, and shares no code with the kernels. The tests take it in float64 as the ground truth.
"""

from __future__ import annotations

import math

import torch

from ..scene import PinholeCamera
from .raster import CulledCounts, Raster, RasterInputs
from .settings import (
    ALPHA_MAX,
    ALPHA_MIN,
    COV_MAX,
    DET_MIN,
    DIRECTION_NORM_MIN,
    INVERSE_ALPHA_MIN,
    JACOBIAN_MARGIN,
    QUAT_NORM2_MIN,
    RADIUS_SIGMAS,
    T_MIN,
    RasterSettings,
)

CHUNK_SIDE = 32
"""Side in pixels of the squares that are rendered one after another. It bounds the memory of the autograd graph."""


def rasterize_reference(inputs: RasterInputs) -> Raster:
    """Render as `engine.rasterizer.rasterize` describes.

    Per pixel, over Gaussians sorted by depth (Kerbl et al. 2023, eq. 3)::

        alpha_i = min(0.99, o_i exp(-1/2 d^T Sigma_i^-1 d)),  0 when below 1/255
        C = sum_i c_i alpha_i T_i,   T_i = prod_{j<i} (1 - alpha_j),   stop before T_{i+1} < 1e-4
    """
    means, quats, scales, opacities = inputs.means, inputs.quats, inputs.scales, inputs.opacities
    camera, settings = inputs.camera, inputs.settings
    dtype = means.dtype
    width, height = camera.width, camera.height
    viewmat = inputs.viewmat.to(dtype)
    in_camera = means @ viewmat[:3, :3].T + viewmat[:3, 3]
    depth = in_camera[:, 2]

    near = ~(depth > settings.near)
    quat_norm2 = (quats * quats).sum(dim=1)
    no_direction = quat_norm2 < QUAT_NORM2_MIN
    # Culled rows get harmless values, so that no infinity enters the graph.
    safe = in_camera.where(~near[:, None], in_camera.new_tensor([0.0, 0.0, 1.0]))
    unit_x = quats.new_tensor([1.0, 0.0, 0.0, 0.0])
    safe_quats = quats.where(~no_direction[:, None], unit_x)

    pixel = project_centres(safe, camera)
    cov_xx, cov_xy, cov_yy, det = project_covariances(safe, safe_quats, scales, viewmat[:3, :3], camera, settings)
    degenerate = ~near & (no_direction | ~(det >= DET_MIN) | ~(torch.maximum(cov_xx, cov_yy) <= COV_MAX))
    if settings.antialiased:
        # The determinant without the low pass: subtract the low pass's part of it (Cauchy-Binet).
        low_pass_part = settings.low_pass * (cov_xx + cov_yy - settings.low_pass)
        opacities = opacities * torch.sqrt(((det - low_pass_part) / det).clamp(min=0.0)).detach()
    transparent = ~near & ~degenerate & (opacities < ALPHA_MIN)
    safe_opacities = opacities.detach().clamp(min=ALPHA_MIN)
    # alpha >= 1/255 inside of the ellipse d^T Sigma^-1 d <= limit, whose half extents are exact.
    limit = 2.0 * torch.log(INVERSE_ALPHA_MIN * safe_opacities).clamp(min=0.0)
    extent = torch.sqrt(limit[:, None] * torch.stack([cov_xx, cov_yy], dim=1).detach())
    low, high = pixel.detach() - extent, pixel.detach() + extent
    size = pixel.new_tensor([width - 0.5, height - 0.5])
    misses_image = ((high < 0.5) | (low > size)).any(dim=1)
    outside = ~near & ~degenerate & ~transparent & misses_image
    visible = ~(near | degenerate | transparent | outside)

    colors = _colors(inputs, -viewmat[:3, :3].T @ viewmat[:3, 3])
    order = torch.argsort(depth.detach().float(), stable=True)
    order = order[visible[order]]
    image = means.new_zeros(height, width, colors.shape[1])
    transmittance = means.new_ones(height, width)
    for top in range(0, height, CHUNK_SIDE):
        for left in range(0, width, CHUNK_SIDE):
            bottom, right = min(top + CHUNK_SIDE, height), min(left + CHUNK_SIDE, width)
            inside = (high[order, 0] >= left) & (low[order, 0] <= right)
            inside &= (high[order, 1] >= top) & (low[order, 1] <= bottom)
            index = order[inside]
            ys, xs = torch.meshgrid(
                torch.arange(top, bottom, dtype=dtype) + 0.5,
                torch.arange(left, right, dtype=dtype) + 0.5,
                indexing="ij",
            )
            dx = xs.reshape(-1, 1) - pixel[index, 0]
            dy = ys.reshape(-1, 1) - pixel[index, 1]
            square = cov_yy[index] * dx * dx - 2.0 * cov_xy[index] * dx * dy + cov_xx[index] * dy * dy
            raw = opacities[index] * torch.exp(-0.5 * square / det[index])
            alpha = raw.clamp(max=ALPHA_MAX)
            alpha = alpha.where(alpha >= ALPHA_MIN, alpha.new_zeros(()))
            with torch.no_grad():
                alive = torch.cumprod(1.0 - alpha, dim=1) >= T_MIN
            alpha = alpha * alive
            after = torch.cumprod(1.0 - alpha, dim=1)
            before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], dim=1)[:, : after.shape[1]]
            shape = (bottom - top, right - left)
            weights = alpha * before
            values = weights @ colors[index]
            if inputs.detached_channels and inputs.channels is not None:
                detached = weights.detach() @ inputs.channels[index]
                values = torch.cat([values[:, : values.shape[1] - detached.shape[1]], detached], dim=1)
            image[top:bottom, left:right] = values.reshape(*shape, -1)
            if len(index):
                transmittance[top:bottom, left:right] = after[:, -1].reshape(shape)

    with torch.no_grad():
        middle = 0.5 * (cov_xx + cov_yy)
        largest = middle + torch.sqrt(0.25 * (cov_xx - cov_yy) ** 2 + cov_xy**2)
        radii = (RADIUS_SIGMAS * torch.sqrt(largest)).where(visible, largest.new_zeros(()))
    counts = CulledCounts(int(near.sum()), int(degenerate.sum()), int(transparent.sum()), int(outside.sum()))
    return Raster(image, transmittance, visible, radii, counts)


def project_centres(in_camera: torch.Tensor, camera: PinholeCamera) -> torch.Tensor:
    """Return the pixel coordinates [N, 2] of points [N, 3] in camera space, in front of the camera."""
    x, y, z = in_camera.unbind(dim=1)
    return torch.stack([camera.K[0, 0] * x / z + camera.K[0, 2], camera.K[1, 1] * y / z + camera.K[1, 2]], dim=1)


def project_covariances(
    in_camera: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    rotation: torch.Tensor,
    camera: PinholeCamera,
    settings: RasterSettings,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return xx, xy and yy [N] of the screen covariances in pixels^2, and their determinants [N].

    Sigma' = M M^T + low_pass I with M = J W R S (Zwicker et al. 2001). J is the affine approximation of the projection
    at the point itself, clamped to at most `JACOBIAN_MARGIN` of the image's size outside of its borders. The distance
    is measured from the borders, so that principal points off the centre are right. A clamped coordinate has no
    gradient through J. The determinant is a sum of squares (Cauchy-Binet), which is exact for needle-shaped Gaussians.

    Parameters
    ----------
    in_camera : tensor of shape [N, 3]
        Centres in camera space, in front of the camera.
    quats : tensor of shape [N, 4]
        Rotations wxyz, of any length but zero.
    scales : tensor of shape [N, 3]
    rotation : tensor of shape [3, 3]
        Rotation of world-to-camera.
    """
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    margin_x, margin_y = JACOBIAN_MARGIN * camera.width, JACOBIAN_MARGIN * camera.height
    x, y, z = in_camera.unbind(dim=1)
    tan_x = (x / z).clamp(float((-margin_x - cx) / fx), float((camera.width + margin_x - cx) / fx))
    tan_y = (y / z).clamp(float((-margin_y - cy) / fy), float((camera.height + margin_y - cy) / fy))
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [torch.stack([fx / z, zero, -fx * tan_x / z], dim=1), torch.stack([zero, fy / z, -fy * tan_y / z], dim=1)],
        dim=1,
    )
    m = jacobian @ rotation @ rotation_matrices(quats) @ torch.diag_embed(scales)
    cov_xx = (m[:, 0] ** 2).sum(dim=1) + settings.low_pass
    cov_yy = (m[:, 1] ** 2).sum(dim=1) + settings.low_pass
    cov_xy = (m[:, 0] * m[:, 1]).sum(dim=1)
    minors = torch.linalg.cross(m[:, 0], m[:, 1])
    det = (minors**2).sum(dim=1) + settings.low_pass * (cov_xx + cov_yy - settings.low_pass)
    return cov_xx, cov_xy, cov_yy, det


def rotation_matrices(quats: torch.Tensor) -> torch.Tensor:
    """Return rotation matrices [N, 3, 3] of quaternions wxyz [N, 4] of any length above 0."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=1).unbind(dim=1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)


def _colors(inputs: RasterInputs, center: torch.Tensor) -> torch.Tensor:
    """Return the values to blend, [N, K]: colours from `sh` as seen from `center` [3], then `channels`."""
    parts = []
    if inputs.sh is not None:
        direction = inputs.means - center
        norm = direction.norm(dim=1, keepdim=True).clamp(min=DIRECTION_NORM_MIN)
        parts.append((0.5 + evaluate_sh(inputs.sh, direction / norm, inputs.sh_degree)).clamp(min=0.0))
    if inputs.channels is not None:
        parts.append(inputs.channels)
    return torch.cat(parts, dim=1)


def evaluate_sh(sh: torch.Tensor, directions: torch.Tensor, degree: int) -> torch.Tensor:
    """Return the colours [N, 3] of coefficients `sh` [N, n_sh, 3] in unit `directions` [N, 3]: sum_k sh_k Y_k.

    Y_k are the real spherical harmonics of bands 0 to `degree`, in the signs and order of 3D Gaussian splatting.
    """
    x, y, z = directions.unbind(dim=1)
    basis = [torch.full_like(x, 0.5 / math.sqrt(math.pi))]
    if degree > 0:
        c1 = math.sqrt(3.0 / (4.0 * math.pi))
        basis += [-c1 * y, c1 * z, -c1 * x]
    if degree > 1:
        c2 = math.sqrt(15.0 / math.pi)
        basis += [
            0.5 * c2 * x * y,
            -0.5 * c2 * y * z,
            0.25 * math.sqrt(5.0 / math.pi) * (2 * z * z - x * x - y * y),
            -0.5 * c2 * x * z,
            0.25 * c2 * (x * x - y * y),
        ]
    if degree > 2:
        c30 = math.sqrt(35.0 / (2.0 * math.pi))
        c31 = math.sqrt(105.0 / math.pi)
        c32 = math.sqrt(21.0 / (2.0 * math.pi))
        basis += [
            -0.25 * c30 * y * (3 * x * x - y * y),
            0.5 * c31 * x * y * z,
            -0.25 * c32 * y * (4 * z * z - x * x - y * y),
            0.25 * math.sqrt(7.0 / math.pi) * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -0.25 * c32 * x * (4 * z * z - x * x - y * y),
            0.25 * c31 * z * (x * x - y * y),
            -0.25 * c30 * x * (x * x - 3 * y * y),
        ]
    return torch.einsum("nk,nkc->nc", torch.stack(basis, dim=1), sh[:, : len(basis)])
