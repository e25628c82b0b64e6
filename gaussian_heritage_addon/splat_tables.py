"""The Gaussians of the visible objects as lists for the shader, and as arrays from which the order is computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import gpu
import numpy as np
from numpy.typing import NDArray

from ..engine.formats import rotations_from_quats
from .splat_order import mean_areas, visible_radii
from .splat_shader import TEXTURE_WIDTH
from .splats import SplatScene

__all__ = ["Part", "Tables", "list_texture"]

Float32 = NDArray[np.float32]
_CHUNK = 1 << 16
"""Gaussians whose covariances are computed at once, to limit the memory of their rotations."""


@dataclass(frozen=True)
class Part:
    """The Gaussians of one object, in its frame.

    Attributes
    ----------
    means : array of shape [N, 3]
    radii : array of shape [N]
        See `visible_radii`.
    weights : array of shape [N]
        Opacity times `mean_areas`.
    membership : array of shape [N], or None for a whole scene
    opacities : array of shape [N]
    shapes : array of shape [N, 12]
        Entry of the shader's list ``shapes``, without the number of the object.
    colors : array of shape [N, n_sh, 3]
        Spherical harmonics.
    """

    means: Float32
    radii: Float32
    weights: Float32
    membership: Float32 | None
    opacities: Float32
    shapes: Float32
    colors: Float32

    @classmethod
    def of(cls, splats: SplatScene) -> Part:
        """Return the Gaussians of an object of Blender.

        Raises
        ------
        ObjectError
            When its attributes were changed.
        """
        means, scales = splats.attribute("position"), splats.attribute("scale")
        base, n_sh = splats.attribute("radiance:base"), (splats.sh_degree + 1) ** 2
        colors = np.empty((len(means), n_sh, 3), np.float32)
        colors[:, 0] = base[:, :3]
        for k in range(1, n_sh):
            colors[:, k] = splats.attribute(f"radiance:sh_{k - 1}")
        opacities = np.ascontiguousarray(base[:, 3])
        shapes = np.zeros((len(means), 12), np.float32)
        shapes[:, :3], shapes[:, 3] = means, opacities
        quats = splats.attribute("rotation")
        for start in range(0, len(means), _CHUNK):
            rows = slice(start, start + _CHUNK)
            axes = rotations_from_quats(quats[rows]) * scales[rows, None, :]
            covariance = axes @ axes.transpose(0, 2, 1)
            shapes[rows, 4:10] = covariance[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)]
        weights = opacities * mean_areas(scales)
        return cls(means, visible_radii(scales, opacities), weights, splats.membership, opacities, shapes, colors)


class Tables:
    """Several objects as the lists of the shader.

    Attributes
    ----------
    parts : list of Part
    starts : list of int
        Row of the first Gaussian of each part, and the number of all.
    n_coefficients : int
        Spherical harmonics of each Gaussian, 1, 4, 9 or 16.
    shapes, colors : GPUTexture
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = list(parts)
        self.starts = [0, *np.cumsum([len(part.means) for part in parts]).tolist()]
        self.n_coefficients = max(part.colors.shape[1] for part in parts)
        shapes = np.concatenate([part.shapes for part in parts])
        for number, part in enumerate(parts):
            shapes[self.starts[number] : self.starts[number] + len(part.means), 10] = number
        self.shapes = list_texture(shapes.reshape(-1, 4))
        colors = np.zeros((self.starts[-1], self.n_coefficients, 4), np.float32)
        for start, part in zip(self.starts, parts, strict=False):
            colors[start : start + len(part.means), : part.colors.shape[1], :3] = part.colors
        # Half precision: 11 bits, of which a colour needs 8.
        self.colors = list_texture(colors.reshape(-1, 4), "RGBA16F")


def list_texture(values: Float32, kind: str = "") -> gpu.types.GPUTexture:
    """Return a list of texels, an array of shape [N] or [N, 4], as a texture."""
    width = 1 if values.ndim == 1 else 4
    rows = max(1, -(-len(values) // TEXTURE_WIDTH))
    padded = np.zeros((rows * TEXTURE_WIDTH, width), np.float32)
    padded[: len(values)] = values.reshape(-1, width)
    data = gpu.types.Buffer("FLOAT", padded.size, padded.ravel())
    return gpu.types.GPUTexture((TEXTURE_WIDTH, rows), format=kind or ("R32F" if width == 1 else "RGBA32F"), data=data)
