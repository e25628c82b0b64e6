"""The Gaussians of the visible objects as lists for the shader, and as arrays from which the order is computed."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import gpu
import numpy as np

from ...engine.core.arrays import Float32
from ...engine.core.errors import ObjectError
from ...engine.scene import rotations_from_quats
from .edited_splats import EditedSplats
from .splat_order import mean_areas, visible_radii
from .splat_shader import TEXTURE_WIDTH
from .splats import SplatScene

_CHUNK = 1 << 16
"""Gaussians whose covariances are computed at once, to limit the memory of their rotations."""


@dataclass(frozen=True)
class Part:
    """The input of the order, for the Gaussians of one object, in its frame.

    Attributes
    ----------
    means : array of shape [N, 3]
    radii : array of shape [N]
        See `visible_radii`.
    weights : array of shape [N]
        Opacity times the square root of `mean_areas`.
    membership : array of shape [N], or None for a whole scene
    checksum : int
        See `checksum`.
    """

    means: Float32
    radii: Float32
    weights: Float32
    membership: Float32 | None
    checksum: int

    @classmethod
    def of(cls, splats: SplatScene | EditedSplats) -> Part:
        """Return the Gaussians of an object of Blender.

        Raises
        ------
        ObjectError
            When its attributes were changed.
        """
        scales = splats.attribute("scale")
        opacities = np.ascontiguousarray(splats.attribute("radiance:base")[:, 3])
        weights = opacities * np.sqrt(mean_areas(scales))
        return cls(
            splats.attribute("position"), visible_radii(scales, opacities), weights, splats.membership, checksum(splats)
        )


def checksum(splats: SplatScene | EditedSplats) -> int:
    """Return a number that changes with whatever is drawn of an object of Blender, apart from its threshold.

    Blender says that the mesh has changed also after a change of the threshold, which is an input of its modifier. To
    look at the numbers takes a tenth of the time that new tables take.

    Raises
    ------
    ObjectError
        When its attributes were changed.
    """
    names = ["position", "scale", "rotation", "radiance:base"]
    names += [f"radiance:sh_{k}" for k in range((splats.sh_degree + 1) ** 2 - 1)]
    found, membership = 0, splats.membership
    for values in [*map(splats.attribute, names), *([] if membership is None else [membership])]:
        found = zlib.crc32(np.ascontiguousarray(values).data, found)
    return found


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

    def __init__(self, objects: Sequence[SplatScene | EditedSplats], parts: Sequence[Part]) -> None:
        self.parts = list(parts)
        self.starts = [0, *np.cumsum([len(part.means) for part in parts]).tolist()]
        self.n_coefficients = max((splats.sh_degree + 1) ** 2 for splats in objects)
        count = self.starts[-1]
        shapes, colors = _empty_list(3 * count), _empty_list(self.n_coefficients * count)
        by_row = shapes[: 3 * count].reshape(count, 12), colors[: self.n_coefficients * count].reshape(count, -1, 4)
        for number, splats in enumerate(objects):
            rows = slice(self.starts[number], self.starts[number + 1])
            _fill_shapes(by_row[0][rows], splats, number)
            _fill_colors(by_row[1][rows], splats)
        self.shapes = _texture(shapes, "RGBA32F")
        # Half precision: 11 bits, of which a colour needs 8.
        self.colors = _texture(colors, "RGBA16F")


def _fill_shapes(shapes: Float32, splats: SplatScene | EditedSplats, number: int) -> None:
    base = splats.attribute("radiance:base")
    shapes[:, :3], shapes[:, 3], shapes[:, 10] = splats.attribute("position"), base[:, 3], number
    quats, scales = splats.attribute("rotation"), splats.attribute("scale")
    for start in range(0, len(shapes), _CHUNK):
        rows = slice(start, start + _CHUNK)
        axes = rotations_from_quats(quats[rows]) * scales[rows, None, :]
        covariance = axes @ axes.transpose(0, 2, 1)
        shapes[rows, 4:10] = covariance[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)]


def _fill_colors(colors: Float32, splats: SplatScene | EditedSplats) -> None:
    colors[:, 0, :3] = splats.attribute("radiance:base")[:, :3]
    for k in range(1, (splats.sh_degree + 1) ** 2):
        colors[:, k, :3] = splats.attribute(f"radiance:sh_{k - 1}")


def list_texture(values: Float32) -> gpu.types.GPUTexture:
    """Return a list of numbers, shape [N], or of texels, shape [N, 4], as a texture."""
    padded = _empty_list(len(values), 1 if values.ndim == 1 else 4)
    padded[: len(values)] = values.reshape(len(values), -1)
    return _texture(padded, "R32F" if values.ndim == 1 else "RGBA32F")


def _empty_list(count: int, width: int = 4) -> Float32:
    """Return zeros, shape [M, width], for at least `count` texels in whole rows of a texture."""
    return np.zeros((max(1, -(-count // TEXTURE_WIDTH)) * TEXTURE_WIDTH, width), np.float32)


def _texture(texels: Float32, kind: str) -> gpu.types.GPUTexture:
    most = gpu.capabilities.max_texture_size_get()
    if len(texels) > TEXTURE_WIDTH * most:
        raise ObjectError("There are more Gaussians than a viewport can draw. Hide objects, or import a smaller scene.")
    data = gpu.types.Buffer("FLOAT", texels.size, texels.ravel())
    return gpu.types.GPUTexture((TEXTURE_WIDTH, len(texels) // TEXTURE_WIDTH), format=kind, data=data)
