"""`rasterize` checks its arguments and calls a backend, all of which give the same image; `scene_on_card` keeps Gaussians."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from ..scene import PinholeCamera
from .raster import Raster, RasterInputs, check_camera, check_finite
from .settings import MAX_CHANNELS, Backend, RasterSettings

if TYPE_CHECKING:
    from .gpu import GpuScene


def rasterize(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    *,
    camera: PinholeCamera,
    sh: torch.Tensor | None = None,
    sh_degree: int | None = None,
    channels: torch.Tensor | None = None,
    detached_channels: bool = False,
    viewmat: torch.Tensor | None = None,
    backend: Backend = "cpu",
    settings: RasterSettings | None = None,
) -> Raster:
    """Render Gaussians front to back into an image of K = (3 if `sh`) + C channels.

    Differentiable in `means`, `quats`, `scales`, `opacities`, `sh`, `channels` and `viewmat`. Gaussians are sorted by
    depth rounded to float32; equal depths are sorted by index.

    Parameters
    ----------
    means : tensor of shape [N, 3]
        Centres, world units.
    quats : tensor of shape [N, 4]
        Rotations wxyz, of any length but zero.
    scales : tensor of shape [N, 3]
        Standard deviations along the axes of the Gaussian (linear, not logarithms), world units.
    opacities : tensor of shape [N]
        Opacities in [0, 1], after the sigmoid.
    sh : tensor of shape [N, n_sh, 3], optional
        Coefficients of spherical harmonics; colour = max(0, 0.5 + SH(direction)).
    sh_degree : int, optional
        Highest band used, 0 to 3; all bands of `sh` by default. Unused bands get zero gradients.
    channels : tensor of shape [N, C], optional
        Further values to blend, such as features, depth or votes.
    detached_channels : bool
        Whether the gradient of these values reaches `channels` alone, and moves and changes no Gaussian.
    viewmat : tensor of shape [4, 4], optional
        World-to-camera, used instead of the camera's own; float64 keeps far origins exact. The gradient is that of
        unconstrained entries: project it to the tangent space of the rotations to move a camera.
    backend : {"cpu", "gpu", "reference"}
        ``cpu`` is fast and takes float32. ``gpu`` takes float32 on the CPU and computes on the graphics card, see
        `engine.rasterizer.gpu`. ``reference`` is slow, written in plain torch, and computes in the dtype of its inputs;
        with float64 it is the ground truth of the tests.

    Returns
    -------
    Raster

    Raises
    ------
    NumericalError
        If an input is not finite. In the backward pass, if an incoming or a resulting gradient is not finite.
    CameraError
        If the camera has skew, an empty image or values that are not finite.
    ValueError
        If the shapes or types of the arguments do not match.

    References
    ----------
    Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering": blending, eq. 3.
    Zwicker et al. 2001, "EWA Volume Splatting": projection of the covariance.
    """
    settings = settings or RasterSettings()
    degree = _check_shapes(means, quats, scales, opacities, sh, sh_degree, channels)
    if viewmat is None:
        viewmat = torch.from_numpy(np.asarray(camera.viewmat, dtype=np.float64))
    elif tuple(viewmat.shape) != (4, 4):
        raise ValueError(f"`viewmat` must have shape (4, 4), got {tuple(viewmat.shape)}")
    else:
        camera = replace(camera, viewmat=viewmat.detach().numpy().astype(np.float64))
    check_camera(camera)
    inputs = RasterInputs(
        means, quats, scales, opacities, sh, channels, viewmat, camera, degree, settings, detached_channels
    )
    if backend == "cpu":
        from .cpu import rasterize_cpu

        return rasterize_cpu(inputs)
    if backend == "gpu":
        from .gpu import open_gpu, rasterize_gpu

        return rasterize_gpu(inputs, open_gpu())
    if backend == "reference":
        from .reference import rasterize_reference

        for name in ("means", "quats", "scales", "opacities", "sh", "channels"):
            value = getattr(inputs, name)
            if value is not None:
                check_finite(name, value)
        return rasterize_reference(inputs)
    raise ValueError(f"backend must be 'cpu', 'gpu' or 'reference', got {backend!r}")


def scene_on_card(
    means: NDArray[np.float32],
    quats: NDArray[np.float32],
    scales: NDArray[np.float32],
    opacities: NDArray[np.float32],
    sh: NDArray[np.float32],
    settings: RasterSettings | None = None,
) -> GpuScene:
    """Copy Gaussians, arrays as in `rasterize`, to the card that its backend ``gpu`` uses, for many pictures and votes.

    Raises
    ------
    EnvironmentProblem
        If there is no card, it fails the self-test, or the Gaussians do not fit.
    """
    from .gpu import GpuScene, open_gpu

    return GpuScene(open_gpu(), means, quats, scales, opacities, sh, settings)


def _check_shapes(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    sh: torch.Tensor | None,
    sh_degree: int | None,
    channels: torch.Tensor | None,
) -> int:
    """Return the band of spherical harmonics to use (0 without `sh`); raise ValueError for shapes that do not match."""
    n = means.shape[0]
    expected = {"means": (means, (n, 3)), "quats": (quats, (n, 4)), "scales": (scales, (n, 3))}
    for name, (value, shape) in {**expected, "opacities": (opacities, (n,))}.items():
        if tuple(value.shape) != shape:
            raise ValueError(f"`{name}` must have shape {shape}, got {tuple(value.shape)}")
    n_out = 0
    degree = 0
    if sh is not None:
        stored = {1: 0, 4: 1, 9: 2, 16: 3}.get(sh.shape[1] if sh.ndim == 3 else 0)
        if stored is None or tuple(sh.shape[::2]) != (n, 3):
            raise ValueError(f"`sh` must have shape ({n}, 1|4|9|16, 3), got {tuple(sh.shape)}")
        degree = stored if sh_degree is None else sh_degree
        if not 0 <= degree <= stored:
            raise ValueError(f"`sh_degree` must be between 0 and {stored}, got {degree}")
        n_out += 3
    if channels is not None:
        if channels.ndim != 2 or channels.shape[0] != n:
            raise ValueError(f"`channels` must have shape ({n}, C), got {tuple(channels.shape)}")
        n_out += channels.shape[1]
    if not 1 <= n_out <= MAX_CHANNELS:
        raise ValueError(f"an image has 1 to {MAX_CHANNELS} channels, but `sh` and `channels` give {n_out}")
    return degree
