"""The one door of the rasterizer: `rasterize`. Implementations behind it give the same picture and gradients."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch

from ..errors import CameraError, NumericalError
from ..scene import PinholeCamera
from .finite import all_finite
from .settings import RasterSettings

__all__ = ["CulledCounts", "Raster", "rasterize"]

MAX_CHANNELS = 64


@dataclass(frozen=True)
class CulledCounts:
    """How many Gaussians were left out of a picture, and why. Each is counted once, in this order.

    Attributes
    ----------
    near : int
        Centre behind the camera or nearer than ``RasterSettings.near``.
    degenerate : int
        Quaternion of length zero, or a screen covariance that cannot be inverted.
    transparent : int
        Opacity below 1/255.
    outside : int
        Nowhere in the picture with an alpha of 1/255 or more.
    """

    near: int
    degenerate: int
    transparent: int
    outside: int

    @property
    def total(self) -> int:
        """All Gaussians that were left out."""
        return self.near + self.degenerate + self.transparent + self.outside


@dataclass(frozen=True)
class Raster:
    """A rendered picture.

    Attributes
    ----------
    image : tensor of shape [H, W, K]
        Blended colours first (3, when `sh` was given), then the channels. No background: composite with
        ``image + transmittance[..., None] * background``. Differentiable.
    transmittance : tensor of shape [H, W]
        Part of the light from behind everything that arrives, 1 where nothing covers. Differentiable.
    visible : bool tensor of shape [N]
        Gaussians that were not culled.
    radii : tensor of shape [N]
        Three standard deviations along the longer axis on the screen in pixels, 0 when culled. No gradient.
    culled : CulledCounts
    """

    image: torch.Tensor
    transmittance: torch.Tensor
    visible: torch.Tensor
    radii: torch.Tensor
    culled: CulledCounts


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
    viewmat: torch.Tensor | None = None,
    backend: Literal["cpu", "reference"] = "cpu",
    settings: RasterSettings | None = None,
) -> Raster:
    """Render Gaussians front to back into a picture of K = (3 if `sh`) + C channels.

    Differentiable in `means`, `quats`, `scales`, `opacities`, `sh`, `channels` and `viewmat` (Kerbl et al. 2023, EWA splatting
    of Zwicker et al. 2001). Order is by depth rounded to float32, equal depths by index.

    Parameters
    ----------
    means : tensor of shape [N, 3]
        Centres, world units.
    quats : tensor of shape [N, 4]
        Rotations wxyz, any length but zero.
    scales : tensor of shape [N, 3]
        Standard deviations along the own axes (linear, not logarithms), world units.
    opacities : tensor of shape [N]
        In [0, 1], the sigmoid already applied.
    camera : PinholeCamera
    sh : tensor of shape [N, n_sh, 3], optional
        Spherical harmonics; colour = max(0, 0.5 + SH(direction)).
    sh_degree : int, optional
        Highest band used, 0 to 3; all that are there by default. Unused bands get zero gradients.
    channels : tensor of shape [N, C], optional
        Anything else to blend: features, depth, votes.
    viewmat : tensor of shape [4, 4], optional
        World-to-camera, in the place of the camera's own; float64 keeps far origins exact. The gradient is that of
        free entries: project it to a rotation's tangent to move a camera.
    backend : {"cpu", "reference"}
        ``cpu``: float32, fast. ``reference``: plain torch in the inputs' dtype (use float64), slow, the judge.
    settings : RasterSettings, optional

    Returns
    -------
    Raster

    Raises
    ------
    NumericalError
        When an input is not finite; here and, for the incoming and outgoing gradients, in the backward pass.
    CameraError
        When the camera has skew, an empty picture or values that are not finite.
    ValueError
        When shapes or types of the arguments do not belong together.
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
    if backend == "cpu":
        from .cpu import rasterize_cpu

        return rasterize_cpu(means, quats, scales, opacities, sh, channels, viewmat, camera, degree, settings)
    if backend == "reference":
        from .reference import rasterize_reference

        arrays = {"means": means, "quats": quats, "scales": scales, "opacities": opacities}
        for name, value in {**arrays, "sh": sh, "channels": channels}.items():
            if value is not None:
                check_finite(name, value)
        return rasterize_reference(means, quats, scales, opacities, sh, channels, viewmat, camera, degree, settings)
    raise ValueError(f"backend must be 'cpu' or 'reference', got {backend!r}")


def check_finite(name: str, value: torch.Tensor) -> None:
    """Raise `NumericalError` naming the array and the first bad row unless all of `value` [N, ...] is finite."""
    values = value.detach().cpu().numpy()  # torch would wake its own threads, which then spin
    if all_finite(values):
        return
    bad = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
    raise NumericalError(
        f"`{name}` is not finite in {int(bad.sum())} of {len(bad)} rows (first: row {int(bad.argmax())}); "
        "lower the learning rate or resume from the last checkpoint."
    )


def _check_shapes(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    sh: torch.Tensor | None,
    sh_degree: int | None,
    channels: torch.Tensor | None,
) -> int:
    """Return the band of spherical harmonics to use (0 without `sh`); raise ValueError for shapes that do not fit."""
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
        raise ValueError(f"a picture has 1 to {MAX_CHANNELS} channels, `sh` and `channels` make {n_out}")
    return degree


def check_camera(camera: PinholeCamera) -> None:
    """Raise `CameraError` for a camera that has no pinhole picture."""
    if camera.width < 1 or camera.height < 1:
        raise CameraError(f"the camera's picture is {camera.width}x{camera.height} pixels; it needs at least one.")
    if not (np.isfinite(camera.viewmat).all() and np.isfinite(camera.K).all()):
        raise CameraError("the camera's pose or intrinsics are not finite; estimate the cameras again.")
    if camera.K[0, 1] != 0 or camera.K[0, 0] <= 0 or camera.K[1, 1] <= 0:
        raise CameraError("the camera must have positive focal lengths and no skew; undistort the photo first.")
