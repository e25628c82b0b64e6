"""Gaussians as plain arrays. NumPy only, because the add-on uses them in Blender."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32
from ..core.errors import ObjectError

FEATURE_DIM = 16
"""Length of the segmentation feature of a Gaussian (Dahaghin et al. 2024)."""


_ARRAYS = ("means", "log_scales", "quats", "opacity_logits", "sh")


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians in the normalised world.

    Attributes
    ----------
    means : array of shape [N, 3], float32
        Centres, in world units.
    log_scales : array of shape [N, 3], float32
        Natural logarithm of the standard deviations along the own axes, world units.
    quats : array of shape [N, 4], float32
        Rotations from own axes to world axes as quaternions wxyz, which need not have unit length.
    opacity_logits : array of shape [N], float32
        Opacity is ``1 / (1 + exp(-logit))``.
    sh : array of shape [N, n_sh, 3], float32
        Spherical harmonics of the sRGB colour in the real basis of 3DGS, n_sh = (degree + 1)^2. The colour is 0.5 plus
        their sum.
    features : array of shape [N, 16], float32, or None
        Segmentation features; None when the scene was trained without them.
    antialiased : bool
        Whether the Gaussians were trained with the 2D filter of Mip-Splatting (Yu et al. 2024), and are drawn with it:
        ``engine.rasterizer.settings.RasterSettings.antialiased``.
    """

    means: Float32
    log_scales: Float32
    quats: Float32
    opacity_logits: Float32
    sh: Float32
    features: Float32 | None = None
    antialiased: bool = False

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
        return int(round(self.sh.shape[1] ** 0.5)) - 1

    @property
    def scales(self) -> Float32:
        """Standard deviations along the own axes, shape [N, 3], in world units."""
        return np.exp(self.log_scales)

    @property
    def opacities(self) -> Float32:
        """Opacities in (0, 1), shape [N]."""
        return (1.0 / (1.0 + np.exp(-self.opacity_logits.astype(np.float64)))).astype(np.float32)

    def __getitem__(self, index: NDArray[np.bool_] | NDArray[np.integer] | slice) -> Gaussians:
        """Return the Gaussians selected by a mask, an index array or a slice."""
        features = None if self.features is None else self.features[index]
        return replace(self, **{name: getattr(self, name)[index] for name in _ARRAYS}, features=features)

    def joined(self, other: Gaussians) -> Gaussians:
        """Return these Gaussians followed by `other`, which must have the same degree and feature length.

        Raises
        ------
        ObjectError
            When one of them is antialiased and the other is not: no file, and no picture, can show both.
        """
        if len(self) and len(other) and self.antialiased != other.antialiased:
            raise ObjectError(
                "Gaussians of anti-aliased training (mip) and others cannot be put together. Export them separately."
            )
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in _ARRAYS}
        features = None
        if self.features is not None and other.features is not None:
            features = np.concatenate([self.features, other.features])
        joined: dict[str, Any] = {name: np.concatenate(pair) for name, pair in pairs.items()}
        return replace(self if len(self) else other, **joined, features=features)
