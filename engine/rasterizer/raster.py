"""Data types and checks that `rasterize` and its backends share: `RasterInputs`, `Raster` and `CulledCounts`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ..core.errors import CameraError, NumericalError
from ..scene import PinholeCamera
from .finite import all_finite
from .settings import RasterSettings


@dataclass(frozen=True)
class RasterInputs:
    """Arguments of `rasterize` after its checks, as a backend takes them.

    Attributes
    ----------
    means, quats, scales, opacities : tensors of shape [N, 3], [N, 4], [N, 3], [N]
    sh : tensor of shape [N, n_sh, 3] or None
    channels : tensor of shape [N, C] or None
    viewmat : tensor of shape [4, 4]
        World-to-camera. It may require a gradient; its values are those of ``camera.viewmat``.
    camera : PinholeCamera
    sh_degree : int
        Highest band of `sh` that is evaluated; 0 without `sh`.
    settings : RasterSettings
    detached_channels : bool
        Whether the gradient of `channels` reaches `channels` alone.
    """

    means: torch.Tensor
    quats: torch.Tensor
    scales: torch.Tensor
    opacities: torch.Tensor
    sh: torch.Tensor | None
    channels: torch.Tensor | None
    viewmat: torch.Tensor
    camera: PinholeCamera
    sh_degree: int
    settings: RasterSettings
    detached_channels: bool = False


def input_tensors(inputs: RasterInputs, backend: str) -> tuple[torch.Tensor, ...]:
    """Return means, quats, scales, opacities, sh and channels; without `sh` its shape is [N, 0, 3], without `channels` [N, 0].

    Raises
    ------
    ValueError
        If a tensor is not float32 on the CPU.
    """
    means = inputs.means
    sh = means.new_zeros(len(means), 0, 3) if inputs.sh is None else inputs.sh
    channels = means.new_zeros(len(means), 0) if inputs.channels is None else inputs.channels
    tensors = (means, inputs.quats, inputs.scales, inputs.opacities, sh, channels)
    for tensor in tensors:
        if tensor.dtype != torch.float32 or tensor.device.type != "cpu":
            raise ValueError(f"the {backend} backend takes float32 on the CPU, got {tensor.dtype} on {tensor.device}")
    return tensors


@dataclass(frozen=True)
class CulledCounts:
    """How many Gaussians were culled, by reason. The reasons are tested in this order and each Gaussian counts once.

    Attributes
    ----------
    near : int
        The centre is behind the camera or closer than ``RasterSettings.near``.
    degenerate : int
        The quaternion has length zero, or the screen covariance cannot be inverted.
    transparent : int
        The opacity is below 1/255.
    outside : int
        Alpha is below 1/255 at every pixel of the image.
    """

    near: int
    degenerate: int
    transparent: int
    outside: int

    @property
    def total(self) -> int:
        """Number of culled Gaussians."""
        return self.near + self.degenerate + self.transparent + self.outside


@dataclass(frozen=True)
class Raster:
    """A rendered image.

    Attributes
    ----------
    image : tensor of shape [H, W, K]
        Blended values: 3 colours first when `sh` was given, then the channels. There is no background; composite one
        with ``image + transmittance[..., None] * background``. Differentiable.
    transmittance : tensor of shape [H, W]
        Fraction of the light from the background that reaches the camera, 1 where no Gaussian covers the pixel.
        Differentiable.
    visible : bool tensor of shape [N]
        Gaussians that were not culled.
    radii : tensor of shape [N]
        Three standard deviations along the longer axis on the screen in pixels, 0 for a culled Gaussian. No gradient.
    culled : CulledCounts
    """

    image: torch.Tensor
    transmittance: torch.Tensor
    visible: torch.Tensor
    radii: torch.Tensor
    culled: CulledCounts


def check_finite(name: str, value: torch.Tensor) -> None:
    """Raise `NumericalError` if a value of `value` [N, ...] is not finite, with `name` and the first such row."""
    values = value.detach().cpu().numpy()  # In torch, the test would start OpenMP threads, which then spin.
    if all_finite(values):
        return
    bad = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
    raise NumericalError(
        f"`{name}` is not finite in {int(bad.sum())} of {len(bad)} rows (first: row {int(bad.argmax())}); "
        "lower the learning rate or resume from the last checkpoint."
    )


def check_camera(camera: PinholeCamera) -> None:
    """Raise `CameraError` if `camera` has an empty image, values that are not finite, skew or a focal length <= 0."""
    if camera.width < 1 or camera.height < 1:
        raise CameraError(f"the camera's image has {camera.width}x{camera.height} pixels; it needs at least one.")
    if not (np.isfinite(camera.viewmat).all() and np.isfinite(camera.K).all()):
        raise CameraError("the camera's pose or intrinsics are not finite; estimate the cameras again.")
    if camera.K[0, 1] != 0 or camera.K[0, 0] <= 0 or camera.K[1, 1] <= 0:
        raise CameraError("the camera must have positive focal lengths and no skew; undistort the photo first.")
