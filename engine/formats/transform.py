"""Transforms of Gaussians (centres, rotations, sizes and view-dependent colour) and conversions of quaternions.

Quaternions are wxyz; a rotation matrix R maps own axes to world axes (column vectors, ``x_world = R x_own``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from ..core.errors import NumericalError
from ..scene import Gaussians, rotations_from_quats, unit_quats
from .spherical_harmonics import orthogonal_sh_matrix

_ROWS_PER_CHUNK = 1 << 9
"""Gaussians transformed at once: intermediate values stay in the processor's cache, and products of matrices are so
small that BLAS does not share them with a second core, on which it would wait while other programs use it."""
_SIMILARITY_TOLERANCE = 1e-5
"""Relative difference of scales up to which a map counts as a similarity; Blender's matrices are float32."""


def transform_gaussians(gaussians: Gaussians, matrix: Float64) -> Gaussians:
    """Return the Gaussians transformed by an affine map; see `AffineMap`, which raises `NumericalError`."""
    return AffineMap.of(matrix, gaussians.sh_degree)(gaussians)


@dataclass(frozen=True)
class AffineMap:
    """An affine map of Gaussians, prepared once for many of them.

    Usually a similarity (rotation, uniform scale, translation). Other affine maps transform the ellipsoids exactly;
    view-dependent colours are then transformed by the nearest orthogonal map, because spherical harmonics cannot
    represent a stretch exactly.

    Attributes
    ----------
    linear : array of shape [3, 3], float64
    translation : array of shape [3], float64
    rotation : array of shape [4], float64
        Quaternion of the nearest rotation.
    growth : float
        Logarithm of the scale of a similarity.
    is_similarity : bool
    bands : tuple of array of shape [3 m, 3 m], float32
        For each degree from 1 on, what a row of the coefficients of this degree, m of three channels, is multiplied
        with; empty where they do not change.
    """

    linear: Float64
    translation: Float64
    rotation: Float64
    growth: np.float32
    is_similarity: bool
    bands: tuple[NDArray[np.float32], ...]

    @classmethod
    def of(cls, matrix: Float64, sh_degree: int) -> AffineMap:
        """Return the map with `matrix` [4, 4] of Gaussians with harmonics of `sh_degree`.

        Raises
        ------
        NumericalError
            When `matrix` is not finite or is singular.
        """
        matrix = np.asarray(matrix, dtype=np.float64)
        linear = matrix[:3, :3]
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise NumericalError(
                "The transform `matrix` must be 4x4 and finite. Reset the object's transform and try again."
            )
        left, singular, right = np.linalg.svd(linear)
        if singular[2] <= 1e-12 * singular[0]:
            raise NumericalError(
                "The transform `matrix` flattens space. Give the object a scale other than 0 and try again."
            )
        orthogonal = left @ right
        spread = singular[0] - singular[2]
        return cls(
            linear=linear,
            translation=matrix[:3, 3],
            rotation=quats_from_rotations(orthogonal[None])[0],
            growth=np.float32(np.log(singular).mean()),
            is_similarity=bool(spread <= _SIMILARITY_TOLERANCE * singular[0] and np.linalg.det(linear) > 0),
            bands=_bands(orthogonal, sh_degree),
        )

    def __call__(self, gaussians: Gaussians) -> Gaussians:
        """Return the transformed `gaussians`; features, and what the map does not change, are shared with them."""
        turned = replace(
            gaussians,
            means=np.empty(gaussians.means.shape, np.float32),
            log_scales=np.empty(gaussians.log_scales.shape, np.float32),
            quats=np.empty(gaussians.quats.shape, np.float32),
            sh=np.empty(gaussians.sh.shape, np.float32) if self.bands else gaussians.sh,
        )
        self.apply(gaussians, into=turned)
        return turned

    def shifted(self, gaussians: Gaussians) -> Gaussians:
        """Return `gaussians` moved by the translation alone: their other arrays keep every bit."""
        means = (gaussians.means.astype(np.float64) + self.translation).astype(np.float32)
        return replace(gaussians, means=means)

    def places(self, means: NDArray[np.floating]) -> Float64:
        """Return the transformed positions [n, 3] of `means` [n, 3], in float64."""
        places: Float64 = means.astype(np.float64) @ self.linear.T + self.translation
        return places

    def apply(self, gaussians: Gaussians, *, into: Gaussians) -> None:
        """Put the transformed `gaussians` into the contiguous arrays of `into`, which may be `gaussians` itself."""
        for start in range(0, len(gaussians), _ROWS_PER_CHUNK):
            rows = slice(start, start + _ROWS_PER_CHUNK)
            into.means[rows] = self.places(gaussians.means[rows])
            if self.is_similarity:
                into.quats[rows] = _multiply_quats(self.rotation, gaussians.quats[rows])
                np.add(gaussians.log_scales[rows], self.growth, out=into.log_scales[rows])
            else:
                into.quats[rows], into.log_scales[rows] = _map_ellipsoids(gaussians[rows], self.linear)
            if self.bands:
                self._turn_colors(gaussians.sh[rows], into.sh[rows])

    def _turn_colors(self, sh: NDArray[np.float32], turned: NDArray[np.float32]) -> None:
        """Put the coefficients `sh` [n, n_sh, 3], turned, into `turned`, which is contiguous."""
        count, n_sh, _ = sh.shape
        before, after = sh.reshape(count, 3 * n_sh), turned.reshape(count, 3 * n_sh)
        after[:, :3] = before[:, :3]
        for degree, band in enumerate(self.bands, start=1):
            columns = slice(3 * degree * degree, 3 * (degree + 1) * (degree + 1))
            np.matmul(before[:, columns], band, out=after[:, columns])


def _bands(orthogonal: Float64, sh_degree: int) -> tuple[NDArray[np.float32], ...]:
    if sh_degree == 0 or np.array_equal(orthogonal, np.eye(3)):
        return ()
    matrix = orthogonal_sh_matrix(orthogonal, sh_degree).astype(np.float32)
    parts = [slice(degree * degree, (degree + 1) * (degree + 1)) for degree in range(1, sh_degree + 1)]
    # The Kronecker product with the identity applies the matrix to the interleaved colour channels in one product.
    return tuple(np.kron(matrix[part, part], np.eye(3, dtype=np.float32)).T for part in parts)


def _map_ellipsoids(gaussians: Gaussians, linear: Float64) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return quats and log-scales of ``A Sigma A^T``, from the SVD of ``A R S``, which keeps small axes precise."""
    axes = linear @ rotations_from_quats(gaussians.quats) * np.exp(gaussians.log_scales.astype(np.float64))[:, None, :]
    left, sizes, _ = np.linalg.svd(axes)
    # Flipping an axis does not change an ellipsoid, and makes an improper rotation proper.
    left[:, :, 2] *= np.linalg.det(left)[:, None]
    tiny = np.finfo(np.float32).tiny
    return quats_from_rotations(left).astype(np.float32), np.log(np.maximum(sizes, tiny)).astype(np.float32)


def _multiply_quats(left: Float64, right: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the quaternion products ``left * right[n]`` (wxyz), which have the lengths of `right`."""
    w, x, y, z = left
    table = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    product: NDArray[np.float32] = (right.astype(np.float64) @ table.T).astype(np.float32)
    return product


def quats_from_rotations(rotations: Float64) -> Float64:
    """Return unit wxyz quaternions [N, 4], float64, w >= 0, of rotation matrices [N, 3, 3].

    Notes
    -----
    The largest component is computed from the diagonal and the others by division, which avoids cancellation for
    rotations by 180 degrees (Shepperd 1978).
    """
    r = np.asarray(rotations, dtype=np.float64)
    d0, d1, d2 = r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]
    squares = np.stack([1 + d0 + d1 + d2, 1 + d0 - d1 - d2, 1 - d0 + d1 - d2, 1 - d0 - d1 + d2], axis=1)
    wx, wy, wz = r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]
    xy, xz, yz = r[:, 0, 1] + r[:, 1, 0], r[:, 0, 2] + r[:, 2, 0], r[:, 1, 2] + r[:, 2, 1]
    candidates = np.stack(
        [
            np.stack([squares[:, 0], wx, wy, wz], axis=1),
            np.stack([wx, squares[:, 1], xy, xz], axis=1),
            np.stack([wy, xy, squares[:, 2], yz], axis=1),
            np.stack([wz, xz, yz, squares[:, 3]], axis=1),
        ],
        axis=1,
    )
    quats = unit_quats(candidates[np.arange(len(r)), squares.argmax(axis=1)])
    positive: Float64 = np.where(quats[:, :1] < 0, -quats, quats)
    return positive


def logits_of(opacities: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return logits of `opacities` in [0, 1], as float32.

    Notes
    -----
    Opacities of exactly 1 and 0 have infinite logits. They are replaced by the nearest float32 below 1 (logit 16.6) and
    the smallest normal number above 0 (logit -87.3), a change below the rounding of float32.
    """
    clipped = np.clip(opacities.astype(np.float64), np.finfo(np.float32).tiny, 1 - 2.0**-24)
    return (np.log(clipped) - np.log1p(-clipped)).astype(np.float32)
